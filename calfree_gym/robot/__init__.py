"""The arm: its kinematics, its motors, and N of them stepped together by MuJoCo."""
