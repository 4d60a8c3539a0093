# SPDX-License-Identifier: Apache-2.0
import os
import pathlib

import numpy as np
import pytest

import refield

ROOT = pathlib.Path(__file__).resolve().parents[2]
RECIPE = ROOT / "datasets_synthetic/tabletop/recipe.toml"


@pytest.fixture(scope="session")
def program():
    """The command line, which results are compared with."""
    return os.environ["REFIELD_PROGRAM"]


@pytest.fixture(scope="session")
def session(tmp_path_factory):
    """A small simulated session: 40 training photographs and 5 held-out ones."""
    return refield.simulate(RECIPE, tmp_path_factory.mktemp("data") / "truth", size=(24, 18), light_size=(16, 12), train=40, test=(3, 2, 0), quality=1)


@pytest.fixture(scope="session")
def arrays(session):
    light = np.stack([frame.light() for frame in session.train])
    observed = np.stack([frame.observed() for frame in session.train])
    return light, observed


@pytest.fixture(scope="session")
def field(arrays):
    return refield.estimate(*arrays)
