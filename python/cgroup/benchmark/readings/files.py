"""What the readings of a run leave in its folder: tables and a figure."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING

import pandas as pd

from cgroup.benchmark.readings.questions import name_questions, read_questions
from cgroup.benchmark.readings.tables import as_csv, as_markdown
from cgroup.io import write_file
from cgroup.plots import readings_figure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from cgroup.benchmark.readings.outcomes import ReadingOutcome

MARKDOWN, CSV, FIGURE = "readings.md", "readings.csv", "readings.png"
"""Names of the files."""

_TITLE = "Claims of the paper by reading"


def write_readings(folder: Path, outcomes: Sequence[ReadingOutcome]) -> list[Path]:
    """Write tables and figure of all readings.

    Parameters
    ----------
    folder : path
        Of the run.
    outcomes : sequence of ReadingOutcome
        Of `judge_readings`.

    Returns
    -------
    list of path
        `MARKDOWN`, `CSV` and `FIGURE` in the folder.

    Raises
    ------
    InputError
        If a file can't be written.

    Examples
    --------
    >>> from pathlib import Path
    >>> import pandas as pd
    >>> from cgroup.benchmark.readings import judge_readings, write_readings
    >>> outcomes = judge_readings(pd.DataFrame(), pd.DataFrame(), [])  # no records
    >>> [file.name for file in write_readings(Path(), outcomes)]
    ['readings.md', 'readings.csv', 'readings.png']
    """
    questions = read_questions()
    picture = BytesIO()
    readings_figure(_list_cells(outcomes), title=_TITLE).savefig(picture, format="png")
    contents = {
        MARKDOWN: as_markdown(outcomes, questions).encode(),
        CSV: as_csv(outcomes, questions).encode(),
        FIGURE: picture.getvalue(),
    }
    for name, content in contents.items():
        write_file(folder / name, content)
    return [folder / name for name in contents]


def _list_cells(outcomes: Sequence[ReadingOutcome]) -> pd.DataFrame:
    """One row per claim and reading, as the figure takes them."""
    asked = name_questions(read_questions())
    rows = [
        {
            "group": asked.get(outcome.name, ""),
            "reading": outcome.name,
            "claim": claim,
            "verdict": verdict.verdict,
            "close": outcome.is_close(claim),
            "moved": outcome is outcomes[0] or claim in outcome.moved,
        }
        for outcome in outcomes
        for claim, verdict in outcome.verdicts.items()
    ]
    return pd.DataFrame(rows)
