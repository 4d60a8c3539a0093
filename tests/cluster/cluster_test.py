#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""usage: cluster_test.py REFIELD RECIPE [CASE...]

`refield submit` on a real Slurm cluster of three nodes on this machine, with injected faults. Each case must end
with the field of a single run, byte for byte, or with a message that names the shard and its log. Prints a table
of the faults and their outcomes. Exit status 77: skipped.
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
    """A run of `refield submit`, and what it submitted."""

    def __init__(self, lab, name, *options, session=None, output=None, environment=None):
        self.lab = lab
        self.environment = {**lab.cluster.environment, **(environment or {})}
        self.output = output or lab.folder / f"{name}.rfield"
        self.shards = Path(f"{self.output}.shards")
        self.log = lab.folder / f"{name}.log"
        self.process = None
        self.start("submit", session or lab.session, "-o", self.output, "--threads", 1, *options)

    def start(self, *words):
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen([str(word) for word in (self.lab.refield, *words)], stdout=log, stderr=log,
                                            env=self.environment, cwd=self.lab.folder)

    def attach(self):
        self.start("submit", self.shards)

    def resume(self):
        self.start("submit", self.shards, "--resume")

    def cancel(self):
        return subprocess.run([self.lab.refield, "submit", self.shards, "--cancel"], env=self.lab.cluster.environment,
                              capture_output=True, text=True)

    def text(self):
        return self.log.read_text()

    def state(self):
        return json.loads((self.shards / "job.json").read_text())

    def wait_for(self, condition, what, seconds=120):
        def checked():
            if self.process.poll() not in (None, 0):
                raise RuntimeError(f"submit ended while waiting for {what}:\n{self.text()}")
            return condition()
        slurm.Cluster.wait_until(checked, seconds * self.lab.patience, what)

    def array_job(self):
        try:
            return self.state()["rounds"][-1]["array_job"]
        except (OSError, ValueError):
            return 0

    def wait_submitted(self):
        self.wait_for(lambda: self.state()["rounds"][-1]["merge_job"] != 0, "submitted jobs")

    def done(self):
        return len(list((self.shards / "shards").glob("[0-9]*.rfield")))

    def estimators(self):
        """(pid, shard) of the estimators that run."""
        found = []
        for pid, command, _ in slurm.processes():
            shard = re.search(re.escape(f"-o {self.shards}/shards/") + r"(\d+)\.rfield$", command)
            if shard and f"{self.lab.refield} estimate" in command and not command.startswith("/bin/sh"):
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

    def end(self, seconds=300):
        try:
            return self.process.wait(seconds * self.lab.patience)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"submit goes on:\n{self.text()}") from None

    def expect_field(self, whole=None):
        status = self.end()
        assert status == 0, f"status {status}:\n{self.text()}"
        assert self.output.read_bytes() == (whole or self.lab.whole), "another field than that of a single run"
        rounds = self.state()["rounds"]
        resubmitted = sum(len(one["shards"]) for one in rounds[1:])
        return "same field" + (f", {resubmitted} shard(s) submitted again" if resubmitted else "")


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


def greedy_task(lab, shard):
    """An environment in which the first task of a shard takes 700 MB before it begins. Slurm kills process after process:
    the task must not go on meanwhile."""
    folder = lab.folder / "greedy"
    folder.mkdir()
    command = folder / "rm"  # the first program that shard.sh runs
    command.write_text(f"""#!/bin/sh
case "$*" in */end/{shard}) if mkdir {folder}/begun 2>/dev/null; then /usr/bin/python3 -c '
import time
memory = b"x" * 700_000_000
time.sleep(100)' || kill -KILL $PPID; fi ;; esac
exec /bin/rm "$@"
""")
    command.chmod(0o755)
    return {"PATH": f"{folder}:{os.environ['PATH']}"}


def everything_at_once(lab):
    """64 shards; a node dies, a task exceeds its memory, the controller restarts, submit is killed and attached again"""
    shard = 3
    one = Submission(lab, "everything", "--shards", 64, "--task-memory", 0.4, environment=greedy_task(lab, shard))
    one.wait_for(lambda: one.done() >= 6, "six shards")
    node = None
    while node is None:
        node = lab.cluster.busy_node(other_than_of=shard)  # which would run again, and not exceed its memory
    lab.cluster.kill_node(node)
    one.wait_for(lambda: one.done() >= 12, "twelve shards")
    # By SIGTERM, at which it saves its state. One that is killed forgets what it started within the last seconds, starts
    # that again, and takes the nodes, which then have two such jobs, out of service until an administrator resumes them.
    lab.cluster.end("slurmctld")
    time.sleep(2)
    lab.cluster.start_controller()
    one.wait_for(lambda: one.done() >= 20, "twenty shards", 240)
    one.process.kill()
    one.process.wait()
    time.sleep(1)
    lab.cluster.start_node(node)
    one.attach()
    outcome = one.expect_field()
    second = one.state()["rounds"][1]
    assert shard in second["shards"] and second["limits"]["memory_mib"] == 820, f"shard {shard} got no more memory"
    assert "exceeded its memory limit" in (one.shards / "log/merge.log").read_text()
    return outcome


def requeued(lab):
    """preemption: SIGTERM, then requeued"""
    one = Submission(lab, "requeued", "--shards", 6)
    pid, shard = one.stop_an_estimator()
    lab.cluster.slurm("scontrol", "requeue", f"{one.array_job()}_{shard}")
    slurm.kill(pid, signal.SIGCONT)
    outcome = one.expect_field()
    assert len(one.state()["rounds"]) == 1, "submitted again although Slurm requeued it"
    return outcome + ", requeued by Slurm"


def time_limit(lab):
    """a task hangs until its time limit"""
    one = Submission(lab, "time", "--shards", 6, "--time", 1)
    one.stop_an_estimator()
    outcome = one.expect_field()
    assert one.state()["rounds"][1]["limits"]["minutes"] == 2, one.text()
    return outcome + ", with 2 min"


def killed_estimator(lab):
    """an estimator is killed, as by the kernel without memory"""
    one = Submission(lab, "killed", "--shards", 6)
    pid, shard = one.stop_an_estimator()
    slurm.kill(pid)
    outcome = one.expect_field()
    first, second = one.state()["rounds"]
    assert second["shards"] == [shard] and second["limits"]["memory_mib"] == 2 * first["limits"]["memory_mib"]
    return outcome + ", with twice the memory"


def cancelled_task(lab):
    """one task is cancelled with scancel"""
    one = Submission(lab, "task", "--shards", 6)
    pid, shard = one.stop_an_estimator()
    lab.cluster.slurm("scancel", f"{one.array_job()}_{shard}")
    slurm.kill(pid, signal.SIGCONT)
    return one.expect_field()


def lost_merge(lab):
    """the merge job is cancelled"""
    one = Submission(lab, "merge", "--shards", 6)
    one.wait_submitted()
    pid, _ = one.stop_an_estimator()
    lab.cluster.slurm("scancel", one.state()["rounds"][0]["merge_job"])
    slurm.kill(pid, signal.SIGCONT)
    return one.expect_field() + ", merged by submit"


def killed_while_submitting(lab):
    """submit is killed between sbatch and recording the job"""
    one = Submission(lab, "recording", "--shards", 6)
    one.wait_submitted()
    pid, _ = one.stop_an_estimator()
    one.process.kill()
    one.process.wait()
    state = one.state()
    number = state["rounds"][0]["array_job"]
    state["rounds"][0].update(array_job=0, merge_job=0)
    (one.shards / "job.json").write_text(json.dumps(state))
    one.attach()
    slurm.kill(pid, signal.SIGCONT)
    outcome = one.expect_field()
    assert one.state()["rounds"][0]["array_job"] == number, "submitted twice"
    return outcome + ", nothing submitted twice"


def cancelled(lab):
    """submit with --cancel, then --resume"""
    one = Submission(lab, "cancelled", "--shards", 6)
    one.wait_submitted()
    pid, _ = one.stop_an_estimator()
    one.wait_for(lambda: one.done() >= 1, "a shard")
    done = one.cancel()
    assert done.returncode == 0 and "--resume" in done.stdout, done
    slurm.kill(pid, signal.SIGCONT)
    assert one.end() == 2 and "cancelled" in one.text(), one.text()
    array = one.array_job()
    slurm.Cluster.wait_until(
        lambda: not lab.cluster.slurm("squeue", "--noheader", f"--jobs={array}").strip(), 60 * lab.patience, "no tasks")
    kept = one.done()
    assert kept >= 1
    one.resume()
    outcome = one.expect_field()
    assert len(one.state()["rounds"][1]["shards"]) == 6 - kept
    return outcome


def detached(lab):
    """Ctrl-C while following, then --attach"""
    one = Submission(lab, "detached", "--shards", 6)
    one.wait_submitted()
    pid, _ = one.stop_an_estimator()
    one.process.send_signal(signal.SIGINT)
    assert one.end() == 130 and "the jobs go on" in one.text(), one.text()
    one.attach()
    slurm.kill(pid, signal.SIGCONT)
    outcome = one.expect_field()
    assert len(one.state()["rounds"]) == 1
    return outcome


def without_slurm(lab):
    """--engine parallel: an estimator is killed"""
    one = Submission(lab, "parallel", "--shards", 3, "--hosts", ":")
    pid, _ = one.stop_an_estimator()
    slurm.kill(pid)
    return one.expect_field() + ", started again by GNU parallel"


def full_disk(lab):
    """the file system of the shards is full, then is not"""
    disk = lab.folder / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8m", "none", disk], capture_output=True).returncode != 0:
        return "SKIPPED: no right to mount"
    try:
        one = Submission(lab, "full", "--shards", 6, output=disk / "full.rfield")
        one.wait_submitted()
        pid, _ = one.stop_an_estimator()
        filler = disk / "filler"
        try:
            with open(filler, "wb", buffering=0) as file:
                while True:
                    file.write(bytes(4096))
        except OSError:
            pass
        slurm.kill(pid, signal.SIGCONT)
        status = one.end()
        text = one.text()
        assert status == 2 and "No space left" in text + "".join(
            file.read_text() for file in (one.shards / "log").glob("*.log")), text
        filler.unlink()
        one.resume()
        return "named; after making room: " + one.expect_field()
    finally:
        subprocess.run(["umount", "-l", disk], check=False)


def damaged_photograph(lab):
    """a photograph is truncated while shards are estimated"""
    session = lab.folder / "damaged_session"
    shutil.copytree(lab.session, session)
    photograph = sorted((session / "observed").glob("*.exr"))[5]
    content = photograph.read_bytes()
    lab.run("estimate", session, "-o", "repaired.rfield", "--threads", "1")  # a field records its session
    one = Submission(lab, "photograph", "--shards", 6, session=session)
    one.wait_submitted()
    one.wait_for(lambda: one.done() >= 1, "a shard")
    photograph.write_bytes(content[:200])
    assert one.end() == 2, one.text()
    named = re.search(r"shard \d+ ended with exit status 2.*see (\S+)", one.text())
    assert named and photograph.name in Path(named[1]).read_text(), one.text()
    photograph.write_bytes(content)
    one.resume()
    return "shard and log named; after repair: " + one.expect_field((lab.folder / "repaired.rfield").read_bytes())


def damaged_shard(lab):
    """bytes of a completed shard change on disk"""
    one = Submission(lab, "shard", "--shards", 6)
    pid, _ = one.stop_an_estimator()
    one.wait_for(lambda: one.done() >= 1, "a shard")
    shard = next((one.shards / "shards").glob("[0-9]*.rfield"))
    content = bytearray(shard.read_bytes())
    middle = len(content) // 2
    content[middle:middle + 64] = bytes(byte ^ 0x55 for byte in content[middle:middle + 64])
    shard.write_bytes(content)
    slurm.kill(pid, signal.SIGCONT)
    return one.expect_field()


def other_capture(lab):
    """a photograph is replaced by another one while shards are estimated"""
    session = lab.folder / "other_session"
    shutil.copytree(lab.session, session)
    photographs = sorted((session / "observed").glob("*.exr"))
    one = Submission(lab, "other", "--shards", 6, session=session)
    one.wait_submitted()
    one.wait_for(lambda: one.done() >= 1, "a shard")
    photographs[5].write_bytes(photographs[9].read_bytes())
    assert one.end() == 2 and not one.output.exists(), one.text()
    assert "different captures" in one.text() or "another capture" in one.text(), one.text()
    return "refused, no field written"


ALONE = [everything_at_once]
TOGETHER = [time_limit, requeued, killed_estimator, cancelled_task, lost_merge, killed_while_submitting, cancelled, detached,
            without_slurm, full_disk, damaged_photograph, damaged_shard, other_capture]


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
    missing = [tool for tool in ("slurmctld", "slurmd", "sbatch", "munged", "parallel") if not shutil.which(tool)]
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
