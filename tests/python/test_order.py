# SPDX-License-Identifier: Apache-2.0
"""Results do not depend on what the process did before: libraries leave behind floating-point states, for example."""
import os
import pathlib
import random
import subprocess
import sys

import order_steps
import pytest

SEQUENCES = int(os.environ.get("REFIELD_ORDER_SEQUENCES", "6"))


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """Made in a process of its own, as the references are."""
    folder = tmp_path_factory.mktemp("inputs")
    subprocess.run([sys.executable, "-c", f"import pathlib, order_steps; order_steps.make_inputs(pathlib.Path({str(folder)!r}))"],
                   cwd=pathlib.Path(__file__).parent, check=True)
    return folder


@pytest.fixture(scope="module")
def alone(inputs):
    """What each step gives in a fresh process."""
    return {step: subprocess.run([sys.executable, order_steps.__file__, inputs, step], check=True, text=True,
                                 capture_output=True).stdout.strip() for step in order_steps.STEPS}


@pytest.mark.parametrize("sequence", range(SEQUENCES))
def test_any_order_of_calls_gives_the_results_of_fresh_processes(inputs, alone, sequence):
    steps = random.Random(sequence).choices(list(order_steps.STEPS), k=6)
    program = f"import order_steps\nfor step in {steps!r}: print(order_steps.run(step, {str(inputs)!r}))"
    results = subprocess.run([sys.executable, "-c", program], cwd=pathlib.Path(__file__).parent, check=True, text=True,
                             capture_output=True).stdout.split()
    assert results == [alone[step] for step in steps], steps


def test_a_floating_point_state_of_the_caller_changes_nothing_and_stays(inputs, alone):
    """PyTorch, for example, lets its users flush denormals in their thread."""
    flush = ("import ctypes, order_steps\n"
             "libm = ctypes.CDLL('libm.so.6')\n"
             "state = (ctypes.c_uint32 * 8)()\n"
             "libm.fegetenv(state); state[7] |= 0x8040; libm.fesetenv(state)\n"
             f"print(order_steps.run('estimate_dark', {str(inputs)!r}), order_steps.run('view', {str(inputs)!r}))\n"
             "libm.fegetenv(state); print(hex(state[7] & 0x8040))")
    results = subprocess.run([sys.executable, "-c", flush], cwd=pathlib.Path(__file__).parent, check=True, text=True,
                             capture_output=True).stdout.split()
    assert results == [alone["estimate_dark"], alone["view"], "0x8040"]
