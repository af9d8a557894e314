"""The agent `memory`, and how it keeps, maps, discards or recalls what it knows when the world has changed.

It answers the questions of the paper's section 5. A trial goes through this folder from the top down:

1. `memory`: the agent. It asks what it remembers where gripper and object will be seen, lets the servo go
   there, and hands on what was seen in the trial.
2. `adaptive_memory`: decides what to do with that. Has the world changed? Which world is it? It also keeps
   the knowledge of earlier worlds (`Archive`).
3. `detector`: whether what was seen contradicts what is known, and whether in one camera, in both, or in the
   arm.
4. `explanation`: what has changed, by the most probable of all changes that it knows: `CameraChange` (a
   camera turned, zoomed or moved) and `ArmChange` (motors reversed, stronger, or with another zero).
5. `remembered`: the knowledge itself: looks at gripper and object, over registers, as Gaussian processes that
   are kept small. `pairs`: looks of a trial as they are handed on, and the gripper as seen at home.
"""
