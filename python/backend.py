# SPDX-License-Identifier: Apache-2.0
"""PEP 517 backend without dependencies: CMake builds and installs the component `python`, this packs the wheel.

Works without a network and without build isolation; needs the packages that ./dev installs for the build.
"""
import base64
import hashlib
import os
import pathlib
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import zipfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
VERSION = re.search(r"project\(refield VERSION ([0-9.]+)", (ROOT / "CMakeLists.txt").read_text())[1]
PYTHON = f"cp{sys.version_info[0]}{sys.version_info[1]}"
TAG = f"{PYTHON}-{PYTHON}-" + re.sub(r"[-.]", "_", sysconfig.get_platform())
METADATA = f"""Metadata-Version: 2.1
Name: refield
Version: {VERSION}
Summary: Image-based reflectance fields: estimation and relighting
License: Apache-2.0
Requires-Python: >=3.9
Requires-Dist: numpy
"""


def get_requires_for_build_wheel(config_settings=None):
    return []


def get_requires_for_build_sdist(config_settings=None):
    return []


def run(*command):
    subprocess.check_call([str(word) for word in command])


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    with tempfile.TemporaryDirectory() as work:
        # A build folder of the caller's keeps objects from one call to the next.
        build = os.environ.get("REFIELD_BUILD_DIR", f"{work}/build")
        run("cmake", "-S", ROOT, "-B", build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", "-DCMAKE_CXX_FLAGS_RELEASE=-O3",
            "-DCMAKE_UNITY_BUILD=ON", "-DREFIELD_PYTHON=ON", "-DREFIELD_BENCHMARKS=OFF", "-DREFIELD_STUDIES=OFF",
            f"-DPython3_EXECUTABLE={sys.executable}", "-DCMAKE_INSTALL_RPATH=$ORIGIN")
        run("cmake", "--build", build, "--target", "refield_python")
        run("cmake", "--install", build, "--strip", "--component", "python", "--prefix", f"{work}/root")
        packages = pathlib.Path(work, "root/lib/python3/dist-packages")
        # The library that the module links lies beside it.
        run("cmake", "--install", build, "--strip", "--component", "shared", "--prefix", f"{work}/shared")
        for library in pathlib.Path(work, "shared/lib").glob("librefield.so.*"):
            if library.name.count(".") == 3:  # librefield.so.MAJOR.MINOR, as the module names it
                shutil.copyfile(library, packages / "refield" / library.name)
        files = {path.relative_to(packages).as_posix(): path.read_bytes()
                 for path in sorted(packages.rglob("*")) if path.is_file()}
    info = f"refield-{VERSION}.dist-info"
    files[f"{info}/METADATA"] = METADATA.encode()
    files[f"{info}/WHEEL"] = f"Wheel-Version: 1.0\nGenerator: refield\nRoot-Is-Purelib: false\nTag: {TAG}\n".encode()
    files[f"{info}/licenses/LICENSE"] = (ROOT / "LICENSE").read_bytes()
    record = [f"{name},sha256={base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b'=').decode()},{len(data)}\n"
              for name, data in files.items()]
    files[f"{info}/RECORD"] = ("".join(record) + f"{info}/RECORD,,\n").encode()
    wheel = f"refield-{VERSION}-{TAG}.whl"
    with zipfile.ZipFile(os.path.join(wheel_directory, wheel), "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return wheel


def build_sdist(sdist_directory, config_settings=None):
    name = f"refield-{VERSION}"
    tracked = subprocess.check_output(["git", "-C", str(ROOT), "ls-files", "-z"], text=True).split("\0")
    with tarfile.open(os.path.join(sdist_directory, f"{name}.tar.gz"), "w:gz") as archive:
        for path in filter(None, tracked):
            archive.add(ROOT / path, f"{name}/{path}", recursive=False)
    return f"{name}.tar.gz"
