# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C, threads, processes and Jupyter kernels."""
import multiprocessing
import os
import signal
import subprocess
import sys
import textwrap
import threading

import numpy as np
import pytest

import refield

PATIENCE = 600  # seconds; ends what hangs


@pytest.fixture(scope="module")
def long_work():
    """Arrays whose estimate takes many seconds."""
    random = np.random.default_rng(3)
    return random.random((120, 24, 32, 3), dtype=np.float32), random.random((120, 150, 200, 3), dtype=np.float32)


def is_interrupted(work):
    """Whether SIGINT from another thread ends ``work``, which gets a progress function. The thread runs only while the
    work leaves it the interpreter, and strikes once there is progress to report."""
    begun = threading.Event()

    def strike():
        begun.wait()
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=strike)
    thread.start()
    try:
        work(lambda stage, done, total: begun.set())
        return False
    except KeyboardInterrupt:
        return True
    finally:
        begun.set()
        thread.join()


def test_ctrl_c_ends_an_estimate(long_work, arrays, field):
    assert is_interrupted(lambda progress: refield.estimate(*long_work, progress=progress))
    light = np.ones(field.light_shape, np.float32)
    assert np.array_equal(refield.estimate(*arrays).relight(light), field.relight(light))


def test_ctrl_c_ends_a_batch(field):
    lights = np.zeros((20000, *field.light_shape), np.float32)
    out = np.empty((200, *field.shape), np.float32)
    assert is_interrupted(lambda progress: [field.relight(lights[:200], out=out, progress=progress) for _ in range(100000)])


def test_estimate_in_a_thread_while_the_main_thread_is_interrupted(arrays, field):
    light, observed = (np.concatenate([array] * 2) for array in arrays)  # long enough to still run
    results = []
    begun = threading.Event()

    def estimate():
        results.append(refield.estimate(light, observed, progress=lambda *_: begun.set()))

    thread = threading.Thread(target=estimate)
    thread.start()
    begun.wait()
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
        threading.Event().wait()
    thread.join()
    assert results[0].shape == field.shape


def test_two_threads_relight_one_field(field):
    lights = np.random.default_rng(4).random((24, *field.light_shape), dtype=np.float32)
    expected = [field.relight(light) for light in lights]
    relighter = field.relighter("fine")
    wrong = []

    def relight(order):
        for i in order:
            if not np.array_equal(field.relight(lights[i]), expected[i]):
                wrong.append(i)
            if not np.allclose(relighter.relight(lights[i]), expected[i], rtol=1e-4, atol=1e-5):
                wrong.append(i)
            if not np.allclose(field.relight(lights)[i], expected[i], rtol=1e-4, atol=1e-5):
                wrong.append(i)

    threads = [threading.Thread(target=relight, args=(order,)) for order in (range(24), range(23, -1, -1))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def brightness(field):
    return float(field.relight(np.ones(field.light_shape, np.float32)).sum())


def error_of(field):
    try:
        return brightness(field)
    except refield.Error as error:
        return str(error)


def test_spawned_processes(field):
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        assert pool.map(brightness, [field, field]) == [brightness(field)] * 2


def test_forked_processes():
    """Before the first use a fork works; afterwards the child is told so instead of hanging."""
    script = textwrap.dedent("""
        import multiprocessing, sys
        import numpy as np
        import refield
        def use(_):
            light = np.random.default_rng(1).random((12, 4, 4, 3), dtype=np.float32)
            try:
                return refield.estimate(light, light).shape
            except refield.Error as error:
                return str(error)
        fork = multiprocessing.get_context("fork")
        with fork.Pool(2) as pool:
            assert pool.map(use, [1, 2]) == [(4, 4, 3)] * 2
        assert use(0) == (4, 4, 3)
        with fork.Pool(2) as pool:
            assert all("'spawn'" in text for text in pool.map(use, [1, 2]))
        assert use(0) == (4, 4, 3)
    """)
    subprocess.run([sys.executable, "-c", script], check=True)


def test_jupyter_kernel_is_interrupted_and_used_again():
    from jupyter_client.manager import start_new_kernel

    manager, client = start_new_kernel(kernel_name="python3", startup_timeout=PATIENCE)
    try:
        def execute(code, is_interrupted=False):
            request = client.execute(code, stop_on_error=False)
            while is_interrupted:
                message = client.get_iopub_msg(timeout=PATIENCE)
                if message["msg_type"] == "stream" and "begun" in message["content"]["text"]:
                    manager.interrupt_kernel()
                    break
            while True:
                reply = client.get_shell_msg(timeout=PATIENCE)
                if reply["parent_header"].get("msg_id") == request:
                    return reply["content"]

        assert execute("import numpy as np, refield; r = np.random.default_rng(3);"
                       "light = r.random((120, 24, 32, 3), dtype=np.float32);"
                       "observed = r.random((120, 150, 200, 3), dtype=np.float32)")["status"] == "ok"
        reply = execute("print('begun', flush=True); refield.estimate(light, observed)", is_interrupted=True)
        assert reply["status"] == "error" and reply["ename"] == "KeyboardInterrupt"
        reply = execute("shape = refield.estimate(light[:, :4, :4], observed[:, :5, :6]).shape; assert shape == (5, 6, 3)")
        assert reply["status"] == "ok", reply
    finally:
        client.stop_channels()
        manager.shutdown_kernel(now=True)
