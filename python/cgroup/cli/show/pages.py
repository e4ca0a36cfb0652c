"""``--html``: a result as a page to turn around, beside the other files of a command."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from cgroup._checks.quoting import escape
from cgroup.cli.streams import write_error
from cgroup.cli.wording import reword
from cgroup.errors import NoConsensusError
from cgroup.io._results import make_folder

if TYPE_CHECKING:
    from collections.abc import Generator
    from pathlib import Path

    from cgroup.registration import Registration
    from cgroup.types import PointCloud

REGISTRATION_PAGE = "registration.html"
COMPARISON_PAGE = "comparison.html"


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


@contextmanager
def page_of_refused(
    context: Any,  # noqa: ANN401 - typer's
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
            refusal = str(reword(error, context))
            write_registration_page(make_folder(folder), clouds, error.registration, title, refusal)
            where = escape(str(folder))
            write_error(f"cgroup: wrote {REGISTRATION_PAGE} of the guess that is refused to {where}/")
        raise
