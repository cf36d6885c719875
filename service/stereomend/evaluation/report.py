"""The report of one evaluation: Markdown, CSV and one self-contained page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from stereomend.evaluation.pictures import WORST_PX, Gallery
from stereomend.evaluation.run import Row
from stereomend.evaluation.tables import as_csv, as_markdown, make_tables

_NOTES = (
    "Mean ± standard deviation over frames; p of Wilcoxon's signed-rank test, two-sided and paired by frame, "
    "against the raw map. Each method's lowest means are bold.",
    "A pixel without a prediction counts as disparity 0 and as depth 0.",
)


def prepare_stem(output: Path) -> Path:
    """Make the folder of a report, before the long work (raises OSError).

    Args:
        output: a folder that exists, for `report.md` and so on in it; otherwise what the three paths begin
            with, its ending dropped where it is one of theirs.
    """
    if output.is_dir():
        return output / "report"
    output.parent.mkdir(parents=True, exist_ok=True)
    return output.with_suffix("") if output.suffix in (".md", ".csv", ".html") else output


@dataclass(frozen=True)
class Report:
    """What was evaluated, and what came out."""

    title: str
    notes: Sequence[str]
    """What was evaluated with what, a line each."""
    rows: Sequence[Row]

    def markdown(self) -> str:
        """Title, notes and tables."""
        return as_markdown(make_tables(self.rows), [f"# {self.title}", "", *_paragraphs(self._all_notes())])

    def html(self, gallery: Gallery) -> str:
        """One page that needs no other file; names are escaped."""
        loader = PackageLoader("stereomend.evaluation", ".")
        environment = Environment(
            loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
        )
        return environment.get_template("report.html.j2").render(
            title=self.title,
            notes=self._all_notes(),
            tables=make_tables(self.rows),
            sheets=gallery.sheets,
            ramp=gallery.ramp,
            worst=f"{WORST_PX:g}",
            frames=len({row.frame for row in self.rows}),
        )

    def write(self, stem: Path, gallery: Gallery) -> list[Path]:
        """Write `stem` with `.md`, `.csv` and `.html`; returns the three paths (raises OSError)."""
        texts = {"md": self.markdown(), "csv": as_csv(self.rows), "html": self.html(gallery)}
        paths = [stem.with_name(f"{stem.name}.{ending}") for ending in texts]
        for path, text in zip(paths, texts.values(), strict=True):
            path.write_text(text, encoding="utf-8")
        return paths

    def _all_notes(self) -> list[str]:
        return [*self.notes, *_NOTES]


def _paragraphs(lines: Sequence[str]) -> list[str]:
    return "\n\n".join(lines).split("\n")
