"""Joblib's Dask backend, which by itself waits forever for a task that the cluster has given up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from distributed import KilledWorker
from joblib._dask import DaskDistributedBackend

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Future


@dataclass(frozen=True)
class _GivenUp:
    """Stands in for the result of a task that failed, with the number that `Pool` gave it."""

    number: int
    error: BaseException


class DaskBackend(DaskDistributedBackend):
    """Dask, with a result of None for a task whose workers died one after the other."""

    def submit(self, func: Any, callback: Callable[[Any], Any] | None = None) -> Future[Any]:  # noqa: ANN401
        """Hand a batch of one task to the cluster."""
        submitted = super().submit(func, callback)
        number = func.items[0][1][0]

        def tell(done: Future[Any]) -> None:
            error = done.exception()
            if error is not None and callback is not None:
                callback(_GivenUp(number, error))

        submitted.add_done_callback(tell)
        return submitted

    def retrieve_result_callback(self, out: Any) -> Any:  # noqa: ANN401
        """Return the results of a batch, or raise its error."""
        if not isinstance(out, _GivenUp):
            return super().retrieve_result_callback(out)
        if isinstance(out.error, KilledWorker):
            return [(out.number, None)]
        raise out.error
