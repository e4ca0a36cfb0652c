"""``cgroup demo``: run all methods on a generated pair."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import typer

from cgroup import io
from cgroup.cli import options
from cgroup.cli.commands.compare import compare_methods
from cgroup.cli.help import command, make_app
from cgroup.cli.output import Ending
from cgroup.cli.show.comparison import print_comparison
from cgroup.cli.show.terminal import show_stages
from cgroup.io._results import check_folder, make_folder

_SCANS = ("source.ply", "target.ply", "truth.txt")

app = make_app()


@command(
    app,
    "demo",
    "cgroup demo",
    "cgroup demo --seed 3 --out third --wide",
    "cgroup compare out/source.ply out/target.ply --truth out/truth.txt",
)
def demo_command(
    context: typer.Context,
    *,
    seed: Annotated[int, options.option("NUMBER", "Another seed, another shape.", "Shape", min=0)] = 0,
    out: options.OutOption = options.DEFAULT_OUT,
    html: options.HtmlOption = False,
    save: options.SaveOption = None,
    as_json: options.JsonOption = False,
    wide: options.WideOption = False,
) -> None:
    """Run all methods on a generated pair: two views of a closed shape rich in detail.

    Writes the two scans and their true pose, and all that `cgroup compare` writes.
    """
    from cgroup.datasets import standin_pair  # noqa: PLC0415 - slow to load

    check_folder(out)
    ending = Ending(as_json=as_json, save=save)
    with show_stages() as begin:
        begin("generating two scans")
        pair = standin_pair(seed=seed)
    source, target, truth = (make_folder(out) / name for name in _SCANS)
    io.write_cloud(source, pair.source)
    io.write_cloud(target, pair.target)
    io.write_transform(truth, pair.T_target_source)
    document = compare_methods(
        context,
        (source, target),
        (pair.source, pair.target),
        pair.T_target_source,
        title="Generated pair",
        folder=out,
        html=html,
        written=_SCANS,
    )
    ending.finish(document, partial(print_comparison, wide=wide))
