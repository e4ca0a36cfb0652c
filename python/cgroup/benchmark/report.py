"""One self-contained page with what a run has found: figures, tables, and the claims of the paper."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from datetime import datetime, timezone
from io import BytesIO
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader, StrictUndefined

import cgroup
from cgroup.benchmark import records
from cgroup.benchmark.claims import CRITERIA, OUTCOMES, check_claims, claims_markdown, count_verdicts
from cgroup.benchmark.claims.base import mean_times
from cgroup.benchmark.evidence import EXPERIMENTS, PLACES, Evidence, described
from cgroup.benchmark.report_tables import (
    Table,
    dataset_table,
    failure_table,
    machine_table,
    ranking_table,
    score_table,
    timing_table,
)
from cgroup.io import write_file
from cgroup.plots import (
    inliers_figure,
    pair_precision_figure,
    registration_rate_figure,
    scores_figure,
    timing_figure,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    import pandas as pd
    from matplotlib.figure import Figure

    from cgroup.benchmark.claims import Verdict
    from cgroup.benchmark.evidence import Experiment, Sample
