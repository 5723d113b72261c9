"""Threads: simulations go on at once, so that their linear algebra keeps to one each."""

from __future__ import annotations

from contextlib import AbstractContextManager


def one_blas_thread() -> AbstractContextManager[object]:
    """Return a context in which BLAS works in the thread that calls it.

    Its own threads gain nothing on matrices of a few columns, and while they wait for the
    next one they take the processors from the simulations.
    """
    import scipy.linalg  # noqa: F401 - it brings a BLAS of its own, limited once it is loaded
    from threadpoolctl import threadpool_limits

    limits: AbstractContextManager[object] = threadpool_limits(1, "blas")
    return limits
