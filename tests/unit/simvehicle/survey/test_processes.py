"""Children are started, noticed when they die, and never left behind; real processes, short ones."""

from __future__ import annotations

import os
import pathlib
import signal
import subprocess
import sys
import textwrap
import time

import psutil
import pytest

from simvehicle.survey.processes import Ended, Interrupts, Processes, last_line

SLEEP = [sys.executable, "-c", "import time; time.sleep(300)"]
STUBBORN = [
    sys.executable,
    "-c",
    "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); time.sleep(300)",
]


def wait_until(condition: object, limit_s: float = 20.0) -> None:
    deadline_s = time.monotonic() + limit_s
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < deadline_s, "it never happened"
        time.sleep(0.02)


def test_all_end_together(tmp_path: pathlib.Path) -> None:
    with Processes(tmp_path) as processes:
        processes.start("one", SLEEP)
        processes.start("two", SLEEP)
        pids = [processes.pid(name) for name in processes.running]
        assert all(psutil.pid_exists(pid) for pid in pids)
    assert not any(psutil.pid_exists(pid) for pid in pids)


def test_they_end_with_an_exception_too(tmp_path: pathlib.Path) -> None:
    pids = []

    def fail() -> None:
        with Processes(tmp_path) as processes:
            processes.start("one", SLEEP)
            pids.append(processes.pid("one"))
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert not psutil.pid_exists(pids[0])


def test_who_does_not_listen_is_killed(tmp_path: pathlib.Path) -> None:
    processes = Processes(tmp_path)
    processes.start("deaf", STUBBORN)
    wait_until(lambda: last_line(tmp_path / "deaf.log") == "deaf")
    assert processes.stop(grace_s=0.3) == ["deaf"]
    assert processes.running == ()


def test_who_first_goes_home_is_told_twice(tmp_path: pathlib.Path) -> None:
    program = """
        import signal, time
        told = []
        signal.signal(signal.SIGTERM, lambda *_: told.append(1))
        print("flying", flush=True)
        while len(told) < 2:
            time.sleep(0.02)
        print("recording closed")
    """
    processes = Processes(tmp_path)
    processes.start("agent", [sys.executable, "-c", textwrap.dedent(program)])
    wait_until(lambda: last_line(tmp_path / "agent.log") == "flying")
    assert processes.stop(grace_s=10.0) == []
    assert last_line(tmp_path / "agent.log") == "recording closed"


def test_a_killed_process_has_no_last_words() -> None:
    assert str(Ended("vehicles", -9, "Ctrl-C ends it")) == "vehicles ended (signal 9)"
    assert str(Ended("vehicles", -6, "out of memory")) == "vehicles ended (signal 6): out of memory"


def test_a_death_is_noticed_once_with_its_last_words(tmp_path: pathlib.Path) -> None:
    with Processes(tmp_path) as processes:
        processes.start("short", [sys.executable, "-c", "print('port 5 is in use\\n'); raise SystemExit(2)"])
        seen: list[Ended] = []

        def ended() -> bool:
            seen.extend(processes.ended())
            return bool(seen)

        wait_until(ended)
        assert [str(one) for one in seen] == ["short ended (exit code 2): port 5 is in use"]
        assert processes.ended() == []


def test_a_kill_is_no_unexpected_death(tmp_path: pathlib.Path) -> None:
    with Processes(tmp_path) as processes:
        processes.start("one", SLEEP)
        pid = processes.pid("one")
        assert processes.kill("one")
        assert not processes.kill("one")
        assert not psutil.pid_exists(pid)
        assert processes.ended() == []


def test_who_is_frozen_stands_still_until_it_is_woken_and_ends_in_order(tmp_path: pathlib.Path) -> None:
    with Processes(tmp_path) as processes:
        processes.start("one", SLEEP)
        process = psutil.Process(processes.pid("one"))
        assert processes.freeze("one")
        assert process.status() == psutil.STATUS_STOPPED
        assert processes.ended() == []
        processes.wake("one")
        wait_until(lambda: process.status() != psutil.STATUS_STOPPED)
        assert processes.freeze("one")
        assert processes.stop() == [], "a frozen process is woken to end"
        assert not processes.freeze("one")


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux ends the children of a killed parent")
def test_nothing_outlives_a_killed_launcher(tmp_path: pathlib.Path) -> None:
    program = f"""
        import pathlib, sys, time
        from simvehicle.survey.processes import Processes
        processes = Processes(pathlib.Path({str(tmp_path)!r}))
        processes.start("child", {STUBBORN!r})
        print(processes.pid("child"), flush=True)
        time.sleep(300)
    """
    with subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(program)], stdout=subprocess.PIPE, text=True
    ) as launcher:
        assert launcher.stdout is not None
        child = int(launcher.stdout.readline())
        wait_until(lambda: last_line(tmp_path / "child.log") == "deaf")
        launcher.kill()
        launcher.wait()
    wait_until(lambda: not psutil.pid_exists(child) or psutil.Process(child).status() == psutil.STATUS_ZOMBIE)


def test_the_second_interrupt_is_the_hard_one() -> None:
    before = signal.getsignal(signal.SIGINT)

    def interrupt(number: signal.Signals) -> None:
        os.kill(os.getpid(), number)
        time.sleep(0.0)  # a point at which the interpreter runs the handler

    with Interrupts().watched() as interrupts:
        interrupt(signal.SIGINT)
        assert interrupts.asked
        with pytest.raises(KeyboardInterrupt):
            interrupt(signal.SIGTERM)
    assert signal.getsignal(signal.SIGINT) is before


def test_the_last_line_of_no_log(tmp_path: pathlib.Path) -> None:
    assert last_line(tmp_path / "none.log") == ""
