"""Results as a page and as files. The page needs matplotlib and jinja2, the extra `report`."""

from pathlib import Path

from dcs_jax.evaluation.summary import Summary


def write_report(summary: Summary, path: str | Path) -> Path:
    """Write the page of a summary: `page.write_page`."""
    # matplotlib takes a second to import, and is optional.
    from dcs_jax.evaluation.report.page import write_page

    return write_page(summary, path)
