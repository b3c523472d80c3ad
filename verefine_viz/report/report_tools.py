"""What works out and draws for a report, put together."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from verefine_viz.report.write_report import ReportTools


def report_tools(workers: int = 1) -> ReportTools:
    """The tools of a report, with that many threads for the BOP scores."""
    from verefine_viz.page.share import opened_answer, real_parts, shared, write_shared
    from verefine_viz.page.thumbnails import Painter
    from verefine_viz.report.bop_recalls import bop_recalls
    from verefine_viz.report.write_report import ReportTools

    parts = real_parts()
    return ReportTools(
        lambda runs, progress: bop_recalls(runs, workers, progress),
        lambda gallery: Painter(lambda: gallery),
        lambda gallery, entry, command, objects, prefix: shared(
            opened_answer(gallery, entry, parts), command, "end", objects, prefix
        ),
        write_shared,
    )
