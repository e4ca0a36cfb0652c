"""``--html``: a result as a page to turn around, beside the other files of a command."""

from __future__ import annotations

from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated

import typer

from cgroup._checks.quoting import escape
from cgroup.cli.options import OUTPUT
from cgroup.cli.streams import write_error
from cgroup.cli.wording import reword
from cgroup.errors import InputError, NoConsensusError
from cgroup.io._results import make_folder

if TYPE_CHECKING:
    from collections.abc import Generator
    from pathlib import Path

    from cgroup.comparison import MethodResult
    from cgroup.registration import Registration
    from cgroup.types import BoolArray, Correspondences, FloatArray, PointCloud

REGISTRATION_PAGE = "registration.html"
COMPARISON_PAGE = "comparison.html"


def _need_plotly(wanted: bool) -> bool:
    """Refuse before there is any work."""
    if wanted and find_spec("plotly") is None:
        message = "--html: needs plotly; pip install 'cgroup[scans]'"
        raise InputError(message)
    return wanted


HtmlOption = Annotated[
    bool,
    typer.Option(
        "--html",
        callback=_need_plotly,
        help="Write a page for the browser too: the clouds to turn around.",
        rich_help_panel=OUTPUT,
    ),
]


def write_registration_page(
    folder: Path,
    clouds: tuple[PointCloud, PointCloud],
    done: Registration,
    title: str,
    refusal: str | None = None,
) -> None:
    """Write the page of a registration, or of a guess that was refused."""
    from cgroup.pages import registration_page, write_page  # noqa: PLC0415 - slow to load

    write_page(folder / REGISTRATION_PAGE, registration_page(*clouds, done, title=title, refusal=refusal))


def write_comparison_page(
    folder: Path,
    clouds: tuple[PointCloud, PointCloud],
    matches: Correspondences,
    results: list[MethodResult],
    true_pose: FloatArray,
    correct: BoolArray,
    title: str,
) -> None:
    """Write the page of a comparison."""
    from cgroup.pages import comparison_page, write_page  # noqa: PLC0415 - slow to load

    page = comparison_page(*clouds, matches, results, true_pose, correct=correct, title=title)
    write_page(folder / COMPARISON_PAGE, page)


@contextmanager
def page_of_refused(
    context: typer.Context,
    folder: Path,
    clouds: tuple[PointCloud, PointCloud],
    title: str,
    *,
    wanted: bool,
) -> Generator[None, None, None]:
    """Where no pose can be trusted, write a page of the guess, and let the error pass."""
    try:
        yield
    except NoConsensusError as error:
        if wanted and error.registration is not None:
            refusal = reword(error, context)
            write_registration_page(make_folder(folder), clouds, error.registration, title, refusal)
            write_error(
                f"cgroup: wrote {REGISTRATION_PAGE} of the guess that is refused to {escape(str(folder))}/"
            )
        raise
