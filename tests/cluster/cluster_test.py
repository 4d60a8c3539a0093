#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""usage: cluster_test.py REFIELD RECIPE [CASE...]

`refield submit` on a real Slurm cluster of three nodes on this machine, with injected faults. Each case must end
with the field of a single run, byte for byte, or with a log that names what is wrong. Prints a table of the faults
and their outcomes. Exit status 77: skipped.
"""
import concurrent.futures
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from pathlib import Path

import slurm


class Submission:
    """Runs of `refield submit` for one field, and what they submitted."""

    def __init__(self, lab, name, *options, session=None):
        self.lab = lab
        self.output = lab.folder / f"{name}.rfield"
        self.shards = Path(f"{self.output}.shards")
        self.words = [lab.refield, "submit", session or lab.session, "-o", self.output, "--threads", 1, "--json", *options]
        self.submit()

    def run(self, *options):
        return subprocess.run([str(word) for word in (*self.words, *options)], env=self.lab.cluster.environment,
                              cwd=self.lab.folder, capture_output=True, text=True)

    def submit(self, *options):
        done = self.run(*options)
        assert done.returncode == 0, done.stderr
        self.figures = json.loads(done.stdout)

    def is_over(self):
        """Whether no job is left. Tasks that Slurm holds since their node could not start them are released."""
        queue = self.lab.cluster.slurm("squeue", "--noheader", f"--name={self.figures['name']}", "--format=%i|%r").split("\n")[:-1]
        for job, reason in (line.split("|") for line in queue):
            if "held" in reason:
                self.lab.cluster.slurm("scontrol", "release", job)
        return not queue

    def end(self, seconds=300):
        slurm.Cluster.wait_until(self.is_over, seconds * self.lab.patience, "the end of all jobs")

    def log(self, name):
        return (self.shards / "log" / f"{name}.log").read_text()

    def done(self):
        return len(list((self.shards / "shards").glob("[0-9]*.rfield")))

    def wait_for(self, condition, what, seconds=120):
        slurm.Cluster.wait_until(condition, seconds * self.lab.patience, what)

    def estimators(self):
        """(pid, shard) of the estimators that run."""
        found = []
        for pid, command, _ in slurm.processes():
            shard = re.search(re.escape(f"-o {self.shards}/shards/") + r"(\d+)\.rfield$", command)
            if shard and command.startswith(f"{self.lab.refield} estimate"):
                found.append((pid, int(shard[1])))
        return found

    def stop_an_estimator(self):
        """Suspends one before its shard is complete, so that it is there until the fault comes; its pid and shard."""
        self.wait_for(self.estimators, "an estimator", 240)
        for pid, shard in self.estimators():
            if slurm.suspend(pid) and not (self.shards / "shards" / f"{shard}.rfield").exists():
                return pid, shard
            slurm.kill(pid, signal.SIGCONT)
        return self.stop_an_estimator()

    def expect_field(self, whole=None):
        self.end()
        assert self.output.exists(), f"no field; logs in {self.shards}/log"
        assert self.output.read_bytes() == (whole or self.lab.whole), "another field than that of a single run"
        assert not (self.shards / "shards").exists(), "shards were left"
        return "same field"

    def expect_failure(self):
        self.end()
        assert not self.output.exists(), "merged although shards are missing"


class Lab:
    def __init__(self, refield, recipe, folder):
        self.refield = str(Path(refield).resolve())
        self.folder = Path(folder)
        self.session = self.folder / "session"
        self.patience = float(os.environ.get("REFIELD_PATIENCE", "1"))  # factor on all waiting, for a busy machine
        self.cluster = None
        text = Path(recipe).read_text()
        for key, value in {"width": 40, "height": 64}.items():
            text = re.sub(rf"^{key} = .*", f"{key} = {value}", text, count=1, flags=re.M)
        for key, value in {"train": 60, "natural": 2, "bars": 0, "squares": 0}.items():
            text = re.sub(rf"^{key} = .*", f"{key} = {value}", text, flags=re.M)
        (self.folder / "recipe.toml").write_text(text)
        self.run("--quiet", "simulate", "recipe.toml", "-o", "truth")
        self.run("--quiet", "acquire", "run", "recipe.toml", "--truth", "truth", "-o", "session", "--exposures", "0.003")
        self.run("estimate", "session", "-o", "whole.rfield", "--threads", "1")
        self.whole = (self.folder / "whole.rfield").read_bytes()

    def run(self, *words):
        slurm.run(self.refield, *words, cwd=self.folder)


def everything_at_once(lab):
    """64 shards; a node dies, and the controller restarts"""
    one = Submission(lab, "everything", "--shards", 64)
    one.wait_for(lambda: one.done() >= 6, "six shards")
    node = None
    while node is None:
        node = lab.cluster.busy_node()
    lab.cluster.kill_node(node)
    one.wait_for(lambda: one.done() >= 12, "twelve shards")
    # By SIGTERM, at which it saves its state. One that is killed forgets what it started within the last seconds, starts
    # that again, and takes the nodes, which then have two such jobs, out of service until an administrator resumes them.
    lab.cluster.end("slurmctld")
    time.sleep(2)
    lab.cluster.start_controller()
    one.wait_for(lambda: one.done() >= 20, "twenty shards", 240)
    lab.cluster.start_node(node)
    return one.expect_field()


def requeued(lab):
    """preemption: SIGTERM, then requeued"""
    one = Submission(lab, "requeued", "--shards", 6)
    pid, shard = one.stop_an_estimator()
    lab.cluster.slurm("scontrol", "requeue", f"{one.figures['array_job']}_{shard}")
    slurm.kill(pid, signal.SIGCONT)
    return one.expect_field() + ", requeued by Slurm"


def time_limit(lab):
    """a task hangs until its time limit; submitted again with another one"""
    one = Submission(lab, "time", "--shards", 6, "--sbatch=--time=1")
    one.stop_an_estimator()
    one.expect_failure()
    one.submit("--sbatch=--time=5")
    return one.expect_field()


def killed_estimator(lab):
    """an estimator is killed, as by the kernel without memory; submitted again"""
    one = Submission(lab, "killed", "--shards", 6)
    pid, shard = one.stop_an_estimator()
    slurm.kill(pid)
    one.expect_failure()
    assert one.done() == 5
    one.submit("--sbatch=--mem=1G")
    array = lab.cluster.slurm("scontrol", "show", "job", one.figures["array_job"])
    assert f"ArrayTaskId={shard}" in array, array
    return one.expect_field() + ", one shard submitted again"


def cancelled(lab):
    """a second submission while tasks run; all jobs are cancelled; submitted again"""
    one = Submission(lab, "cancelled", "--shards", 6)
    pid, _ = one.stop_an_estimator()
    second = one.run()
    assert second.returncode == 2 and "queued or running" in second.stderr, second
    lab.cluster.slurm("scancel", f"--name={one.figures['name']}")
    slurm.kill(pid, signal.SIGCONT)
    one.expect_failure()
    other = one.run("--shards", 5)
    assert other.returncode == 2, other
    one.submit()
    return "refused; " + one.expect_field()


def damaged_photograph(lab):
    """a photograph is truncated while shards are estimated; repaired and submitted again"""
    session = lab.folder / "damaged_session"
    shutil.copytree(lab.session, session)
    photograph = sorted((session / "observed").glob("*.exr"))[5]
    content = photograph.read_bytes()
    lab.run("estimate", session, "-o", "repaired.rfield", "--threads", "1")  # a field records its session
    one = Submission(lab, "photograph", "--shards", 12, session=session)  # more than run at a time
    one.wait_for(lambda: one.done() >= 1, "a shard")
    photograph.write_bytes(content[:200])
    one.expect_failure()
    logs = [file.read_text() for file in (one.shards / "log").glob("shard-*.log")]
    assert any(photograph.name in log for log in logs), logs
    photograph.write_bytes(content)
    one.submit()
    return "named in the log; after repair: " + one.expect_field((lab.folder / "repaired.rfield").read_bytes())


def damaged_shard(lab):
    """bytes of a completed shard change on disk; it is removed and submitted again"""
    one = Submission(lab, "shard", "--shards", 6)
    pid, _ = one.stop_an_estimator()
    one.wait_for(lambda: one.done() >= 1, "a shard")
    shard = next((one.shards / "shards").glob("[0-9]*.rfield"))
    content = bytearray(shard.read_bytes())
    middle = len(content) // 2
    content[middle:middle + 64] = bytes(byte ^ 0x55 for byte in content[middle:middle + 64])
    shard.write_bytes(content)
    slurm.kill(pid, signal.SIGCONT)
    one.expect_failure()
    assert str(shard) in one.log("merge"), one.log("merge")
    shard.unlink()
    one.submit()
    return "named in the log; without it: " + one.expect_field()


def other_capture(lab):
    """a photograph is replaced by another one while shards are estimated"""
    session = lab.folder / "other_session"
    shutil.copytree(lab.session, session)
    photographs = sorted((session / "observed").glob("*.exr"))
    one = Submission(lab, "other", "--shards", 24, session=session)  # more than run at a time
    pid, _ = one.stop_an_estimator()
    one.wait_for(lambda: one.done() >= 1, "a shard")
    photographs[5].write_bytes(photographs[9].read_bytes())
    slurm.kill(pid, signal.SIGCONT)
    one.expect_failure()
    logs = [file.read_text() for file in (one.shards / "log").glob("shard-*.log")]
    assert any(photographs[5].name in log and "checksum" in log for log in logs), logs
    return "refused and named in the log, no field written"


ALONE = [everything_at_once]
TOGETHER = [time_limit, requeued, killed_estimator, cancelled, damaged_photograph, damaged_shard, other_capture]


def tried(case, lab):
    begun = time.monotonic()
    try:
        outcome = case(lab)
        passed = True
    except Exception as error:  # the other cases go on
        outcome, passed = f"FAILED: {error}", False
        if not isinstance(error, AssertionError):
            traceback.print_exc()
    print(f"{case.__name__}: {time.monotonic() - begun:.0f} s", flush=True)
    return case.__doc__, outcome, passed


def main():
    if os.geteuid() != 0:
        print("SKIPPED: the daemons of Slurm's nodes are started as root")
        return 77
    os.environ["PATH"] += ":/usr/sbin"
    missing = [tool for tool in ("slurmctld", "slurmd", "sbatch", "munged") if not shutil.which(tool)]
    if missing:
        print("SKIPPED: not installed: " + " ".join(missing))
        return 77
    wanted = sys.argv[3:]
    folder = Path(tempfile.mkdtemp(prefix="refield-cluster-"))
    results = []
    try:
        lab = Lab(sys.argv[1], sys.argv[2], folder)
        with slurm.Cluster(folder / "slurm", nodes=3, cpus=2) as lab.cluster:
            results += [tried(case, lab) for case in ALONE if not wanted or case.__name__ in wanted]
            with concurrent.futures.ThreadPoolExecutor(4) as pool:
                results += pool.map(lambda case: tried(case, lab),
                                    [case for case in TOGETHER if not wanted or case.__name__ in wanted])
    finally:
        if all(passed for _, _, passed in results):
            shutil.rmtree(folder, ignore_errors=True)
        else:
            print(f"kept: {folder}")
    print("\n| fault | outcome |\n| --- | --- |")
    for fault, outcome, _ in results:
        print(f"| {fault} | {outcome} |")
    return 0 if all(passed for _, _, passed in results) else 1


if __name__ == "__main__":
    sys.exit(main())
