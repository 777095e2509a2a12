# SPDX-License-Identifier: BSD-3-Clause
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

import rangecal


def test_progress_is_told_in_the_calling_thread(field):
    told = []
    rangecal.diagnose(field, progress=lambda stage, fraction: told.append((stage, fraction, threading.get_ident())))
    assert told[-1][:2] == ("done", 1.0)
    assert [t[1] for t in told] == sorted(t[1] for t in told)
    assert {t[2] for t in told} == {threading.get_ident()}


def test_an_exception_of_progress_ends_the_work(field):
    def refuse(stage, fraction):
        raise RuntimeError("enough of " + stage)

    for work in (rangecal.calibrate, rangecal.diagnose):
        with pytest.raises(RuntimeError, match="enough of"):
            work(field, progress=refuse)


def stacks():
    """How many stacks of threads there are: each ends in a page that nobody may touch."""
    with open("/proc/self/maps") as maps:
        spans = [line.split()[0].split("-") for line in maps if line.split()[1] == "---p"]
    return sum(int(end, 16) - int(begin, 16) == os.sysconf("SC_PAGE_SIZE") for begin, end in spans)


@pytest.mark.skipif(not os.path.exists("/proc/self/maps"), reason="counts stacks in /proc")
def test_interrupted_work_keeps_no_thread(field):
    def refuse(stage, fraction):
        raise RuntimeError("enough")

    def interrupt(times):
        for _ in range(times):
            with pytest.raises(RuntimeError):
                rangecal.calibrate(field, progress=refuse)
        time.sleep(0.5)   # the last ones come to their next stage
        rangecal.calibrate(field)

    interrupt(5)
    before = stacks()
    interrupt(20)
    assert stacks() - before < 10   # the C library keeps some stacks for threads to come


def test_other_threads_run_meanwhile(field):
    """With the GIL held, the work would leave no turn to the thread that counts."""
    turns = []
    stop = threading.Event()

    def count():
        while not stop.wait(0.001):
            turns.append(1)

    thread = threading.Thread(target=count)
    thread.start()
    began = []
    rangecal.diagnose(field, progress=lambda stage, fraction: began.append(len(turns)))
    stop.set()
    thread.join()
    assert len(turns) > began[0]


def test_ctrl_c_is_a_keyboard_interrupt(field):
    sent = []

    def interrupt(stage, fraction):
        if not sent:
            sent.append(stage)
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        rangecal.diagnose(field, progress=interrupt)
    assert rangecal.diagnose(field, unseen=False).verdict == "no_mismatch"   # the module works on


def test_an_interrupted_program_ends_in_good_order(source):
    code = ("import os, signal, rangecal\n"
            "try:\n"
            "    rangecal.diagnose(r'%s', progress=lambda *_: os.kill(os.getpid(), signal.SIGINT))\n"
            "except KeyboardInterrupt:\n"
            "    print('interrupted')\n" % (source / "notebooks_data/field-layout"))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "interrupted\n", "")
