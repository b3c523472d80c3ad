"""Fixtures decide the tier of a test, and a fast one that starts something fails."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.usefixtures("processes")

RUN = "subprocess.run([sys.executable, '-c', ''], check=True)"
STARTS = {
    "run": RUN,
    "spawn": "multiprocessing.get_context('spawn').Process(target=print).start()",
    "fork": "os.waitpid(os.fork() or os._exit(0), 0)",
    "server": "\n    with socket.socket() as s: s.bind(('127.0.0.1', 0))",
    "caught": f"\n    with contextlib.suppress(BaseException): {RUN}",
    "thread": f"\n    t = threading.Thread(target=lambda: {RUN}); t.start(); t.join()",
}
IMPORTS = "import contextlib, multiprocessing, os, pytest, socket, subprocess, sys, threading\n"
OPTIONS = ("-p", "tests.tiers", "-p", "no:xdist", "-W", "ignore")


@pytest.mark.parametrize("starts", STARTS.values(), ids=list(STARTS))
def test_a_fast_test_that_starts_a_process_or_a_server_fails(pytester: pytest.Pytester, starts: str) -> None:
    pytester.makepyfile(f"{IMPORTS}def test_one(): {starts}")
    done = pytester.runpytest_inprocess(*OPTIONS)
    done.assert_outcomes(failed=1)
    done.stdout.fnmatch_lines("*a fast test starts a *ask for the fixture `processes`*")


@pytest.mark.parametrize("starts", STARTS.values(), ids=list(STARTS))
def test_a_test_that_asks_for_processes_is_slow_and_may_start_them(pytester: pytest.Pytester, starts: str) -> None:
    pytester.makepyfile(f"{IMPORTS}def test_one(processes): {starts}")
    pytester.runpytest_inprocess(*OPTIONS, "-m", "slow").assert_outcomes(passed=1)
    pytester.runpytest_inprocess(*OPTIONS, "-m", "fast").assert_outcomes(deselected=1)


SHARED = """
@pytest.fixture(scope="session")
def shared({asks_for}): {run}

def test_one(shared): pass
"""


def test_a_shared_fixture_that_starts_a_process_fails_the_fast_test_that_sets_it_up(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(IMPORTS + SHARED.format(asks_for="", run=RUN))
    pytester.runpytest_inprocess(*OPTIONS).assert_outcomes(errors=1)


@pytest.mark.parametrize("fixture", ["processes", "long_run"])
def test_who_asks_for_a_fixture_that_asks_for_it_is_slow(pytester: pytest.Pytester, fixture: str) -> None:
    pytester.makepyfile(IMPORTS + SHARED.format(asks_for=fixture, run=RUN))
    pytester.runpytest_inprocess(*OPTIONS, "-m", "slow").assert_outcomes(passed=1)
