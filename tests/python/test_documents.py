# SPDX-License-Identifier: Apache-2.0
"""The guide's examples and the notebooks run, and mypy accepts the examples and the package."""
import os
import re
import shutil
import subprocess
import sys

import pytest

from conftest import ROOT


def guide():
    """The Python blocks of the guide, one program."""
    text = (ROOT / "docs/guide/python.md").read_text(encoding="utf-8")
    return "\n".join(re.findall(r"^```python\n(.*?)^```", text, flags=re.M | re.S))


def test_guide(tmp_path):
    shutil.copytree(ROOT / "datasets_synthetic", tmp_path / "datasets_synthetic")
    (tmp_path / "guide.py").write_text(guide())
    done = subprocess.run([sys.executable, "guide.py"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "natural" in done.stdout and (tmp_path / "chart.svg").exists() and (tmp_path / "scene.rfield").exists()


def test_types(tmp_path):
    # scikit-learn and tqdm of Debian have no types.
    untyped = "[mypy]\n[mypy-sklearn.*,tqdm.*,matplotlib.*]\nignore_missing_imports = True\n"
    (tmp_path / "mypy.ini").write_text(untyped)
    (tmp_path / "guide.py").write_text(guide())
    package = os.path.dirname(sys.modules["refield"].__file__)
    (tmp_path / "wrong.py").write_text("import refield\nrefield.estimate(1, 2).relight()\n")
    check = [sys.executable, "-m", "mypy", "--strict", "--config-file", "mypy.ini", "--cache-dir", os.devnull]
    environment = {**os.environ, "MYPYPATH": os.path.dirname(package)}
    done = subprocess.run([*check, "guide.py", "wrong.py", package], cwd=tmp_path, env=environment, capture_output=True, text=True)
    found = [line for line in done.stdout.splitlines() if "error:" in line]
    assert found and all(line.startswith("wrong.py:2:") for line in found), done.stdout + done.stderr
    assert any("call-arg" in line for line in found), done.stdout


@pytest.mark.parametrize("name", ["first_field", "your_estimator", "ten_thousand_maps"])
def test_notebook(name, monkeypatch):
    import nbclient
    import nbformat

    monkeypatch.delenv("MPLBACKEND", raising=False)  # the kernel draws into the notebook
    notebook = nbformat.read(ROOT / f"python/notebooks/{name}.ipynb", as_version=4)
    nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(ROOT)}}).execute()
    pictures = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs
                if "image/png" in output.get("data", {})]
    assert pictures
    if folder := os.environ.get("REFIELD_KEEP"):  # to look at
        nbformat.write(notebook, os.path.join(folder, f"{name}.ipynb"))
