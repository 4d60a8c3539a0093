# SPDX-License-Identifier: Apache-2.0
"""Resident memory. REFIELD_SLOW_TESTS=1: with an array of 2 GB instead of 0.2 GB."""
import gc
import os
import subprocess
import sys
import textwrap

import numpy as np

import refield


def resident_mb():
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def test_nothing_leaks_over_1000_calls():
    random = np.random.default_rng(2)
    light = random.random((12, 4, 4, 3), dtype=np.float32)
    field = refield.estimate(light, light, mode="fast", predict_errors=False, threads=1)
    lights = random.random((12, *field.light_shape), dtype=np.float32)
    image = np.empty((4, 4, 3), np.float32)
    relighter = field.relighter()

    def calls(count):
        for _ in range(count):
            refield.estimate(light, light, mode="fast", predict_errors=False, threads=1)
            field.relight(light[0])
            field.relight(lights)
            relighter.relight(light[0], out=image)
            relighter.update(light[1], (0, 0, 4, 4))
            field.transport(1, 1), field.kernels(2, 2), field.training_error, field.provenance
            try:
                field.relight(light[0, :2])
            except refield.InputError:
                pass
        gc.collect()

    # The pools of the allocator fill by some MB first; what leaks grows every time: 1 KB per round is 1 MB.
    growth = []
    while len(growth) < 8:
        before = resident_mb()
        calls(1000)
        growth.append(resident_mb() - before)
        if growth[-1] < 0.7:
            return
    raise AssertionError(f"resident memory grows by {growth} MB per 1000 rounds")


def test_a_large_array_is_not_copied():
    gigabytes = 2.0 if os.environ.get("REFIELD_SLOW_TESTS") else 0.2
    script = textwrap.dedent(f"""
        import numpy as np, refield
        def peak():
            with open("/proc/self/status") as file:
                return next(int(line.split()[1]) for line in file if line.startswith("VmHWM")) / 1e3
        images = 40
        side = int(({gigabytes} * 1e9 / (images * 12)) ** 0.5)
        random = np.random.default_rng(1)
        light = random.random((images, 4, 4, 3), dtype=np.float32)
        observed = np.empty((images, side, side, 3), np.float32)
        observed[:] = light.mean(axis=(1, 2))[:, None, None]
        # Few pixels are fitted, so that memory is that of the photographs alone; all of them are read.
        mask = np.zeros((side, side), bool)
        mask[::side // 8, ::side // 8] = True
        refield.estimate(light, observed[:, :64, :64], mask=mask[:64, :64], mode="fast", predict_errors=False)
        before = peak()
        refield.estimate(light, observed, mask=mask, mode="fast", predict_errors=False)
        print(observed.nbytes / 1e6, before, peak())
    """)
    output = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True).stdout
    array, before, after = map(float, output.split())
    print(f"array {array:.0f} MB, peak resident before {before:.0f} MB, after {after:.0f} MB")
    assert before > array
    assert after - before < 0.7 * array, "bands of rows are copied, and the field; never the whole array"
