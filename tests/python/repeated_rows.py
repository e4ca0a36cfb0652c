"""Records of which every pair is another, and what draws of pairs are, the slow way: rows repeated."""

import numpy as np
import pandas as pd


def uneven(frame: pd.DataFrame) -> pd.DataFrame:
    """Records in which no two pairs have the same scores."""
    rng = np.random.default_rng(1)
    names = frame.drop_duplicates(["dataset", "pair"])[["dataset", "pair"]]
    shift = names.assign(shift=rng.normal(0, 0.1, len(names)))
    by_pair = frame[["dataset", "pair"]].merge(shift, how="left", on=["dataset", "pair"])["shift"].to_numpy()
    noise = rng.normal(0, 0.05, len(frame))
    scores = {name: np.clip(frame[name] + by_pair + noise, 0, 1) for name in ("precision", "f_score")}
    return frame.assign(**scores, n=frame["n"] + (1000 * by_pair).round().astype(int))


def repeat_rows(frame: pd.DataFrame, draws: dict[str, pd.DataFrame], number: int) -> pd.DataFrame:
    """Records in which a pair that is drawn three times stands three times, under three names."""
    parts: list[pd.DataFrame] = []
    for (dataset, pair), rows in frame.groupby(["dataset", "pair"]):
        copies = range(int(draws[str(dataset)][pair][number]))
        parts += [rows.assign(pair=f"{pair} ({k})", case=rows["case"] + f" ({k})") for k in copies]
    return pd.concat(parts, ignore_index=True)
