"""Hypothesis profiles and the table that the oracle tests print at the end.

HYPOTHESIS_PROFILE=thorough pytest ... runs many more examples.
"""

import os
import signal
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from hypothesis import HealthCheck, settings

with patch.dict(
    os.environ, OPENBLAS_NUM_THREADS="1"
):  # small matrices are quicker so; children keep the default
    import numpy as np  # noqa: F401 - it reads the variable once

TOO_MUCH = [HealthCheck.too_slow, HealthCheck.data_too_large]
settings.register_profile("default", max_examples=60, deadline=None, suppress_health_check=TOO_MUCH)
settings.register_profile("thorough", max_examples=1000, deadline=None, suppress_health_check=TOO_MUCH)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    # Started in the background: the processes that tests interrupt would inherit the deafness.
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run command lines in an empty folder, of 80 columns; `saved` in it holds the saved runs."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CGROUP_RESULTS", str(tmp_path / "saved"))
    monkeypatch.delenv("COLUMNS", raising=False)
    return tmp_path


class OracleReport:
    """What the comparisons with the reference amounted to, by method."""

    def __init__(self) -> None:
        self.tallies: defaultdict[str, Counter[str]] = defaultdict(Counter)

    def record(self, method: str, *, score_difference: float, examples: int = 1, **counts: int) -> None:
        """Add comparisons."""
        tally = self.tallies[method]
        tally.update(examples=examples, **counts)
        tally["score_difference"] = max(tally["score_difference"], score_difference)

    def lines(self) -> Iterator[str]:
        """Yield the table, one method per line."""
        names = ("examples", "rows", "selected", "ambiguous_rows", "unequal_masks")
        yield f"{'method':<10}{''.join(f'{name:>16}' for name in names)}{'score difference':>18}"
        for method, tally in sorted(self.tallies.items()):
            cells = "".join(f"{tally[name]:>16}" for name in names)
            yield f"{method:<10}{cells}{tally['score_difference']:>18.2e}"


REPORT = pytest.StashKey[OracleReport]()


def pytest_configure(config: pytest.Config) -> None:
    """Start an empty report."""
    config.stash[REPORT] = OracleReport()


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Hand the tallies of a process of pytest-xdist to the one that prints them."""
    if hasattr(session.config, "workeroutput"):
        tallies = session.config.stash[REPORT].tallies
        session.config.workeroutput["tallies"] = {method: dict(tally) for method, tally in tallies.items()}


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Add what a process of pytest-xdist compared."""
    for method, tally in getattr(node, "workeroutput", {}).get("tallies", {}).items():
        node.config.stash[REPORT].record(method, **tally)


@pytest.fixture(scope="session")
def oracle(request: pytest.FixtureRequest) -> OracleReport:
    """Return the report that is printed at the end of the session."""
    return request.config.stash[REPORT]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Print the oracle table when there is anything in it."""
    report = config.stash[REPORT]
    if report.tallies:
        terminalreporter.section("comparison with the NumPy reference")
        for line in report.lines():
            terminalreporter.write_line(line)
