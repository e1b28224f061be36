"""An interactive report of a run in one HTML file, which needs no network: Plotly's program is inside.

Curves are drawn at chosen rows (`elliptude.report.thinning.chosen_rows`), the sphere at up to
`elliptude.report.axes.sphere.FRAMES` times; the numbers in the summary are of all rows.
"""

from elliptude.report.page.summary import summarize
from elliptude.report.page.written import plotly_script, write_report

__all__ = ["plotly_script", "summarize", "write_report"]
