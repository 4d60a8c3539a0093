# SPDX-License-Identifier: Apache-2.0
"""A Slurm cluster on this machine: one controller and virtual nodes on the loopback interface, as root.

Needs Debian's slurmctld, slurmd, slurm-client and munge; no systemd, cgroups or database. Every daemon and file
belongs to the cluster's own folder, so several clusters and an installed Slurm do not disturb each other.
"""
import os
import re
import signal
import socket
import subprocess
import time
from pathlib import Path

# OverMemoryKill: memory limits without cgroups, by polling. ReturnToService: a node that comes back works again.
CONFIGURATION = """\
ClusterName=loopback
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller_port}
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
CredType=cred/munge
SlurmUser=root
SlurmdUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
SchedulerType=sched/backfill
SchedulerParameters=bf_interval=1,sched_interval=1,batch_sched_delay=0,requeue_delay=1
SlurmdParameters=config_overrides
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=1
JobAcctGatherParams=OverMemoryKill
AccountingStorageType=accounting_storage/none
JobRequeue=1
SlurmdTimeout=10
SlurmctldTimeout=10
KillWait=5
MinJobAge=600
ReturnToService=2
NodeName=n[1-{nodes}] NodeHostname={host} NodeAddr=127.0.0.1 Port=[{first_port}-{last_port}] CPUs={cpus} \
RealMemory=8000 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def run(*words, **options):
    return subprocess.run([str(word) for word in words], capture_output=True, text=True, check=True, **options).stdout


def state_of(pid):
    """The letter of proc(5): T for suspended, Z for ended and not yet waited for; X when there is no such process."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return "X"


def is_alive(pid):
    return state_of(pid) not in "XZ"


def processes():
    """(pid, command line, environment) of all processes that can be read."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                command = (entry / "cmdline").read_bytes().decode(errors="replace").replace("\0", " ").strip()
                environment = (entry / "environ").read_bytes().decode(errors="replace").split("\0")
            except OSError:
                continue
            yield int(entry.name), command, environment


def kill(pid, number=signal.SIGKILL):
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        pass


def suspend(pid):
    """Stops a process; False if it ended before that."""
    kill(pid, signal.SIGSTOP)
    while state_of(pid) not in "TXZ":
        time.sleep(0.001)
    return state_of(pid) == "T"


def free_ports(count):
    """The first of `count` successive ports that nothing listens on."""
    for first in range(21000, 30000, count):
        sockets = [socket.socket() for _ in range(count)]
        try:
            for i, one in enumerate(sockets):
                one.bind(("127.0.0.1", first + i))
            return first
        except OSError:
            continue
        finally:
            for one in sockets:
                one.close()
    raise RuntimeError("no free ports")


class Cluster:
    def __init__(self, folder, nodes=3, cpus=1):
        self.folder = Path(folder)
        self.nodes = nodes
        (self.folder / "state").mkdir(parents=True)
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o600)
        port = free_ports(nodes + 1)
        self.configuration = self.folder / "slurm.conf"
        self.configuration.write_text(CONFIGURATION.format(
            host=socket.gethostname().split(".")[0], folder=self.folder, nodes=nodes, cpus=cpus,
            controller_port=port, first_port=port + 1, last_port=port + nodes))
        self.environment = dict(os.environ, SLURM_CONF=str(self.configuration))

    def __enter__(self):
        try:
            run("munged", "--force", f"--key-file={self.folder}/munge.key", f"--socket={self.folder}/munge.socket",
                f"--pid-file={self.folder}/munged.pid", f"--log-file={self.folder}/munged.log",
                f"--seed-file={self.folder}/munged.seed")
            self.start_controller("-c")
            for node in range(1, self.nodes + 1):
                self.start_node(node)
            self.wait_until(lambda: self.states() == ["idle"] * self.nodes, 60, "idle nodes")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        if (self.folder / "slurmctld.pid").exists():
            subprocess.run(["scancel", "--user=root"], env=self.environment, capture_output=True, timeout=30)
        for node in range(1, self.nodes + 1):
            self.end(f"slurmd-n{node}")
        self.end("slurmctld")
        self.end("munged")
        for pid, _, environment in list(processes()):
            if f"SLURM_CONF={self.configuration}" in environment and pid != os.getpid():
                kill(pid)

    def slurm(self, *words):
        return run(*words, env=self.environment)

    def states(self):
        """Of the nodes: idle, mixed, down, ..."""
        return self.slurm("sinfo", "--noheader", "--Node", "--format=%T").split()

    @staticmethod
    def wait_until(condition, seconds, what):
        until = time.monotonic() + seconds
        while True:
            try:
                if condition():
                    return
            except (OSError, subprocess.CalledProcessError):
                pass
            if time.monotonic() > until:
                raise AssertionError(f"gave up after {seconds} s waiting for {what}")
            time.sleep(0.05)

    def pid(self, daemon):
        try:
            return int((self.folder / f"{daemon}.pid").read_text())
        except (OSError, ValueError):
            return None

    def end(self, daemon, number=signal.SIGTERM):
        pid = self.pid(daemon)
        if pid is None or not is_alive(pid):
            return
        kill(pid, number)
        try:
            self.wait_until(lambda: not is_alive(pid), 10, "the end of " + daemon)
        except AssertionError:
            kill(pid)

    def start_controller(self, *words):
        self.slurm("slurmctld", "-f", self.configuration, *words)

    def start_node(self, node):
        # -b: reported as booted, so that the controller starts jobs again that ran there.
        self.slurm("slurmd", "-N", f"n{node}", "-f", self.configuration, "-b")

    def kill_node(self, node):
        """As a power cut would: the daemon, the keepers of its jobs, which would report their end, and the jobs."""
        self.end(f"slurmd-n{node}", signal.SIGKILL)
        spool = self.folder / f"spool-n{node}"
        sockets = [entry for entry in spool.iterdir() if re.fullmatch(rf"n{node}_(\d+)\.\w+", entry.name)]
        jobs = {re.match(r"n\d+_(\d+)", entry.name)[1] for entry in sockets}
        own = [(pid, command, environment) for pid, command, environment in processes()
               if f"SLURM_CONF={self.configuration}" in environment]
        for pid, command, _ in own:
            step = re.match(r"slurmstepd: \[(\d+)\.", command)
            if step and step[1] in jobs:
                kill(pid)
        for pid, _, environment in own:
            if f"SLURMD_NODENAME=n{node}" in environment:
                kill(pid)
        for entry in sockets:
            entry.unlink(missing_ok=True)

    def busy_node(self):
        """A node with a running task; None: there is none."""
        nodes = self.slurm("squeue", "--noheader", "--states=RUNNING", "--format=%N").split()
        return int(nodes[0][1:]) if nodes else None
