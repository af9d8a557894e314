"""Runs as jobs, made by submitit's executor of this machine."""

import os
import signal
from pathlib import Path

import pytest

from experiments.execution.slurm import Slurm, parse_options
from tests.experiments.execution.machines.conftest import assert_nothing_changed, made_anew_until, results

HERE = ("--slurm", "--slurm-option", "cluster=local", "--slurm-option", "array_parallelism=2")


def processes(word, out):
    """Ids of processes whose command line holds a word, and that or the name of an open file the folder."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = entry.read_bytes().decode(errors="replace")
            files = [os.readlink(file) for file in (entry.parent / "fd").iterdir()]
        except OSError:
            continue
        if word in line and any(str(out) in name for name in (line, *files)):
            found.append(int(entry.parent.name))
    return found


def kill_jobs(run, finished_once, tmp_path, kills):
    """Kills jobs, what starts them, or bodies."""

    def kill_one(rng, out):
        what = rng.choice(["submitit.core._submit", "submitit.local._local", "running.worker"])
        if found := processes(what, out):
            os.kill(rng.choice(found), signal.SIGKILL)
        return bool(found)

    def make(out):
        return run(out, *HERE, "--retries", "4")

    for out in made_anew_until(kills, make, kill_one, tmp_path):
        assert_nothing_changed(out, finished_once)


@pytest.mark.slow
def test_a_job_killed_at_some_moment_changes_nothing(run, finished_once, tmp_path):
    kill_jobs(run, finished_once, tmp_path, kills=1)


@pytest.mark.slow
def test_jobs_killed_at_twenty_moments_change_nothing(run, finished_once, tmp_path):
    kill_jobs(run, finished_once, tmp_path, kills=20)


STAND_INS = {
    "sbatch": """
        cat $1 >> {log}
        last=$(grep -o 'array=0-[0-9]*' $1 | grep -o '[0-9]*$')
        for i in $(seq 0 $last); do
            ( export SLURM_JOB_ID=7$i SLURM_ARRAY_JOB_ID=7 SLURM_ARRAY_TASK_ID=$i SLURM_PROCID=0
              export SLURM_LOCALID=0 SLURM_NODEID=0 SLURM_NTASKS=1 SLURM_JOB_NUM_NODES=1
              bash $1 ) > /dev/null 2>&1 &
        done
        echo Submitted batch job 7""",
    "srun": """
        while [[ $1 == --* ]]; do [[ $1 == --unbuffered ]] && shift || shift 2; done
        exec "$@" """,
    "sacct": """
        echo 'JobID|State|NodeList'
        for i in 0 1; do echo "7_$i|RUNNING|here"; done""",
}
"""Slurm's commands, as submitit calls them, for one array whose jobs all begin at once."""


@pytest.mark.slow
def test_runs_are_one_array_with_the_options(run, finished_once, tmp_path, monkeypatch):
    log = tmp_path / "log"
    for name, text in STAND_INS.items():
        (tmp_path / name).write_text("#!/bin/bash\n" + text.replace("{log}", str(log)))
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    options = ("partition=long", "timeout_min=60", "mem_gb=4", "array_parallelism=1")
    options = [word for option in options for word in ("--slurm-option", option)]
    assert run(tmp_path / "out", "--slurm", *options) == 0
    assert results(tmp_path / "out") == results(finished_once)
    script = log.read_text()
    assert script.count("#SBATCH --array=") == 1
    for option in ("--array=0-1%1", "--partition=long", "--time=60", "--mem=4GB"):
        assert f"#SBATCH {option}\n" in script


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--slurm", "--slurm-option", "speed=3"], "found 'speed'; allowed: account, array_parallelism"),
        (
            ["--slurm", "--slurm-option", "timeout_min=long"],
            "timeout_min=long: found 'long'; must be a number",
        ),
        (["--slurm", "--slurm-option", "array_parallelism=0"], "array_parallelism=0: found '0'"),
        (["--slurm", "--slurm-option", "cluster=moon"], "cluster=moon: allowed: slurm, local"),
        *(
            (
                ["--slurm", "--slurm-option", f"mem_gb={wrong}"],
                f"mem_gb={wrong}: found '{wrong}'; must be a number",
            )
            for wrong in ("-4", "0", "nan", "inf")
        ),
        (
            ["--slurm", "--slurm-option", "qos=low", "--slurm-option", "qos=high"],
            "qos=high: qos is given twice",
        ),
        (["--slurm-option", "mem_gb=4"], "--slurm-option: found without --slurm"),
        (["--slurm"], 'Could not detect "srun"'),
    ],
    ids=lambda value: value[-1] if isinstance(value, list) else "",
)
def test_a_wrong_option_is_one_error(run, tmp_path, capsys, monkeypatch, options, said):
    monkeypatch.setenv("PATH", "")
    assert run(tmp_path / "out", *options) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert said in error


def test_setup_may_be_several_commands():
    given = ("setup=module load mujoco", "mem_gb=0.5", "setup=export A=b=c")
    assert parse_options(given) == {"setup": ["module load mujoco", "export A=b=c"], "mem_gb": 0.5}


def test_more_orders_than_slurm_takes_at_once_are_several_arrays(tmp_path, monkeypatch):
    slurm, sizes = Slurm(tmp_path, {"cluster": "local", "array_parallelism": 5000}), []

    def submitted(function, orders):
        sizes.append(len(orders))
        return [object() for _ in orders]

    monkeypatch.setattr(slurm._executor, "map_array", submitted)
    orders = [tmp_path / str(i) for i in range(2500)]
    slurm.start(orders)
    assert sizes == [1000, 1000, 500]
    assert list(slurm._jobs.values()) == orders
