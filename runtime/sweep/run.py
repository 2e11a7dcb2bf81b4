"""A sweep from jobs to results: what is in the journal already is not run again."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from runtime.sweep.job import Job, Result
from runtime.sweep.journal import Journal
from runtime.sweep.pools import Pool, outcomes


def run(jobs: Sequence[Job], pool: Pool, journal: Journal, tell: Callable[[Result], None]) -> dict[str, Result]:
    """The result of every job by key; tell: called with each that is new.

    What failed is no result: it is not in the journal, and the next call tries it again.
    """
    results = {job.key: journal.results[job.key] for job in jobs if job.key in journal.results}
    for job, result in outcomes(pool, [job for job in jobs if job.key not in results]):
        if result["feasible"] is not None:
            journal.add(job, result)
        results[job.key] = result
        tell(result)
    return results
