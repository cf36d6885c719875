"""Rows of single frames, and tables over all frames as in the paper's Tables 2 to 4."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from stereomend.evaluation.run import ALL, RAW, VISIBLE, Row
from stereomend.evaluation.statistics import Comparison, Summary, compare, summarise

MEASURES: Mapping[str, str] = MappingProxyType(
    {
        "rmse_px": "RMSE [px]",
        "epe_px": "EPE [px]",
        "bad2_percent": "bad-2 [%]",
        "bad3_percent": "bad-3 [%]",
        "depth_rmse_mm": "depth RMSE [mm]",
    }
)
"""From the key of a measure to the head of its column; less is better in all."""

REGIONS: Mapping[str, str] = MappingProxyType(
    {ALL: "All pixels with known truth", VISIBLE: "Without occluded pixels"}
)
"""From the key of a region to its title."""

_COLUMNS = (
    *("rmse_px", "epe_px", "bad1_percent", "bad2_percent", "bad3_percent"),
    *("depth_rmse_mm", "missing_percent", "pixels"),
)


@dataclass(frozen=True)
class Cell:
    """One measure of one method and variant."""

    summary: Summary
    test: Comparison | None
    """Against the raw map; None for the raw map itself."""
    best: bool
    """Whether no other variant of the method has a lower mean."""

    @property
    def text(self) -> str:
        """Mean and standard deviation."""
        mean, deviation = self.summary
        return f"{mean:.2f} ± {deviation:.2f}" if deviation is not None else f"{mean:.2f}"

    @property
    def p(self) -> str:
        """The p-value, `-` where there is none, empty for the raw map."""
        if self.test is None:
            return ""
        if self.test.p is None:
            return "-"
        return f"{self.test.p:.3f}" if self.test.p >= 0.001 else "< 0.001"


@dataclass(frozen=True)
class Line:
    """One method and variant."""

    method: str
    variant: str
    cells: Sequence[Cell]


@dataclass(frozen=True)
class Table:
    """One region."""

    title: str
    heads: Sequence[str]
    lines: Sequence[Line]

    @property
    def reasons(self) -> list[str]:
        """Why p-values are missing, each reason once."""
        tests = [cell.test for line in self.lines for cell in line.cells]
        return sorted({test.why for test in tests if test is not None and test.why})


def make_tables(rows: Sequence[Row]) -> list[Table]:
    """Summarise at least one row; one table per region that every row has."""
    regions = [name for name in REGIONS if all(name in row.regions for row in rows)]
    return [_table(rows, region) for region in regions]


def _table(rows: Sequence[Row], region: str) -> Table:
    known = [key for key in MEASURES if all(key in row.regions[region] for row in rows)]
    lines: list[Line] = []
    for method in dict.fromkeys(row.method for row in rows):
        lines.extend(_lines([row for row in rows if row.method == method], region, known))
    return Table(REGIONS[region], [MEASURES[key] for key in known], lines)


def _lines(rows: Sequence[Row], region: str, known: Sequence[str]) -> Iterator[Line]:
    """All variants of one method."""
    variants = list(dict.fromkeys(row.variant for row in rows))
    columns = {key: _column(rows, region, key) for key in known}
    for variant in variants:
        yield Line(rows[0].method, variant, [columns[key][variant] for key in known])


def _column(rows: Sequence[Row], region: str, key: str) -> dict[str, Cell]:
    values: dict[str, list[float]] = {}
    for row in rows:
        values.setdefault(row.variant, []).append(row.regions[region][key])
    summaries = {variant: summarise(some) for variant, some in values.items()}
    least = min(summary.mean for summary in summaries.values())
    return {
        variant: Cell(
            summaries[variant],
            None if variant == RAW else compare(values[RAW], some),
            summaries[variant].mean == least,
        )
        for variant, some in values.items()
    }


def as_markdown(tables: Sequence[Table], head: Sequence[str]) -> str:
    """Write tables under some lines of text; p is in brackets, the lowest mean bold."""
    lines = [*head]
    for table in tables:
        lines += ["", f"## {table.title}", "", _pipes(["method", "variant", *table.heads])]
        lines.append(_pipes(["---", "---", *["---:"] * len(table.heads)]))
        lines += [_line(one) for one in table.lines]
        lines += [text for reason in table.reasons for text in ("", f"p is -: {reason}.")]
    return "\n".join(lines) + "\n"


def _line(line: Line) -> str:
    return _pipes([_plain(line.method), _plain(line.variant), *map(_bold, line.cells)])


def _pipes(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _bold(cell: Cell) -> str:
    text = f"**{cell.text}**" if cell.best else cell.text
    return f"{text} ({cell.p})" if cell.p else text


def _plain(name: str) -> str:
    """A name that comes from a file system, kept from being read as Markdown or HTML."""
    return re.sub(r"([\\`*<>|\[\]&])", r"\\\1", " ".join(name.split()))


def as_csv(rows: Sequence[Row]) -> str:
    """Write one line per frame, method and variant; what a dataset does not know stays empty."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    named = [(region, key) for region in REGIONS for key in _COLUMNS]
    columns = [key if region == ALL else f"{region}_{key}" for region, key in named]
    writer.writerow(["frame", "method", "variant", *columns])
    for row in rows:
        values = [row.regions.get(region, {}).get(key, "") for region, key in named]
        writer.writerow([row.frame, row.method, row.variant, *values])
    return file.getvalue()
