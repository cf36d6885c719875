import base64
import csv
import io
from html.parser import HTMLParser

import numpy as np
import pytest

from stereomend.evaluation.frame import Frame
from stereomend.evaluation.pictures import Gallery
from stereomend.evaluation.report import Report, prepare_stem
from stereomend.evaluation.run import Row
from stereomend.evaluation.tables import as_csv, make_tables
from stereomend.opencv import cv2

EVIL = "<script>alert(1)</script>|**`&"
RAW = [3.0, 5.0, 4.0, 7.0, 6.0, 9.0]
PAPER = [2.0, 4.5, 3.0, 6.0, 5.5, 1.0]


def values(rmse, **more):
    given = {"rmse_px": rmse, "epe_px": rmse / 2, "bad1_percent": 9, "bad2_percent": 8, "bad3_percent": 7}
    return given | {"missing_percent": 0.5, "pixels": 100} | more


def rows(method="net", **more):
    for number, (before, after) in enumerate(zip(RAW, PAPER, strict=True)):
        for variant, rmse in (("raw", before), ("paper", after)):
            yield Row(f"frame {number}", method, variant, {"all": values(rmse, **more)})


class Page(HTMLParser):
    """What a browser would see."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.text, self.sources = [], [], []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.sources += [value for name, value in attrs if name in ("src", "href")]

    def handle_data(self, data):
        self.text.append(data.strip())


def gallery(most=8, names=("frame 0",), method="net"):
    made = Gallery(most)
    truth = np.tile(np.linspace(5, 9, 30, dtype=np.float32), (20, 1))
    image = np.full((20, 30), 77, np.uint8)
    for name in names:
        made.show(name, method, Frame(image, image, truth), {"raw": truth * 0, "paper": truth + 1})
    return made


def test_cells_are_mean_deviation_and_p():
    (table,) = make_tables(list(rows()))
    raw, paper = table.lines
    assert table.heads == ["RMSE [px]", "EPE [px]", "bad-2 [%]", "bad-3 [%]"]
    assert (raw.cells[0].text, raw.cells[0].p) == ("5.67 ± 2.16", "")
    # All six are better: 2 / 2^6, but ties leave only the normal approximation.
    assert paper.cells[0].text == "3.67 ± 1.99"
    assert 0.02 < float(paper.cells[0].p) < 0.04
    assert (raw.cells[0].best, paper.cells[0].best) == (False, True)
    assert paper.cells[2].p == "-"
    assert table.reasons == ["no frame differs"]


def test_depth_and_occlusion_appear_where_all_frames_have_them():
    with_depth = list(rows(depth_rmse_mm=2.5))
    assert make_tables(with_depth)[0].heads[-1] == "depth RMSE [mm]"
    assert make_tables([*with_depth, *rows("other")])[0].heads[-1] == "bad-3 [%]"
    both = [Row(r.frame, r.method, r.variant, {**r.regions, "visible": values(1.0)}) for r in rows()]
    assert [table.title for table in make_tables(both)] == [
        "All pixels with known truth",
        "Without occluded pixels",
    ]
    assert make_tables(both)[1].lines[0].cells[0].text == "1.00 ± 0.00"


def test_methods_are_compared_with_their_own_raw_map():
    better = [Row(r.frame, "b", r.variant, {"all": values(0.5)}) for r in rows()]
    lines = make_tables([*rows("a"), *better])[0].lines
    assert [(line.method, line.variant) for line in lines] == [
        *(("a", "raw"), ("a", "paper"), ("b", "raw"), ("b", "paper"))
    ]
    assert [line.cells[0].p for line in lines][2:] == ["", "-"]
    assert lines[1].cells[0].best


def test_csv_has_every_value_unrounded():
    made = [
        Row('a,"b"', "net", "raw", {"all": values(1 / 3, depth_rmse_mm=2 / 3)}),
        Row("c", "net", "raw", {"all": values(2 / 3), "visible": values(0.25)}),
    ]
    first, second = csv.DictReader(io.StringIO(as_csv(made)))
    assert (first["frame"], float(first["rmse_px"]), float(first["depth_rmse_mm"])) == ('a,"b"', 1 / 3, 2 / 3)
    assert (second["depth_rmse_mm"], float(second["visible_rmse_px"])) == ("", 0.25)
    assert (first["visible_rmse_px"], second["visible_depth_rmse_mm"], first["pixels"]) == ("", "", "100")


def test_names_are_text_in_the_page_and_in_markdown():
    report = Report(f"on {EVIL}", [f"note {EVIL}"], list(rows(EVIL)))
    page = Page(report.html(gallery(names=[EVIL], method=EVIL)))
    assert "script" not in page.tags
    assert page.text.count(EVIL) == 3  # in the table, over the sheet, over the strip
    cells = next(line for line in report.markdown().splitlines() if line.startswith("| ") and " raw " in line)
    assert cells.startswith(r"| \<script\>alert(1)\</script\>\|\*\*\`\& | raw | 5.67")


def test_the_page_needs_no_other_file_and_shows_the_first_frames():
    shown = gallery(most=2, names=["frame 0", "frame 1", "frame 2"])
    page = Page(Report("t", [], list(rows())).html(shown))
    assert page.sources
    assert all(source.startswith("data:image/jpeg;base64,") for source in page.sources)
    assert "2 of 6 frames. Black: unknown." in page.text
    assert [text for text in page.text if text.startswith("frame ")] == ["frame 0", "frame 1"]


def test_errors_are_painted_dark_to_bright_and_unknown_truth_black():
    truth = np.full((32, 32), 9, np.float32)
    truth[:8] = 0
    given = truth.copy()
    given[8:16] = 0  # no prediction: off by 9 px
    made = Gallery(1)
    image = np.zeros((32, 32), np.uint8)
    made.show("f", "m", Frame(image, image, truth), {"raw": given})
    uri = made.sheets[0].strips[0].errors[0].uri
    data = np.frombuffer(base64.b64decode(uri.partition(",")[2]), np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1].astype(int)
    assert np.abs(picture[2:6]).max() < 12
    assert np.abs(picture[10:14] - (253, 231, 37)).max() < 12  # the bright end of viridis
    assert np.abs(picture[20:] - (68, 1, 84)).max() < 12  # the dark end


@pytest.mark.parametrize("name", ["new/deep/out", "new/out.html", "new/out.md"])
def test_a_stem_gives_three_files_beside_each_other(tmp_path, name):
    stem = prepare_stem(tmp_path / name)
    paths = Report("t", [], list(rows())).write(stem, gallery())
    assert [path.name for path in paths] == ["out.md", "out.csv", "out.html"]
    assert all(path.parent == (tmp_path / name).parent and path.stat().st_size for path in paths)


def test_a_folder_gets_files_named_report(tmp_path):
    paths = Report("t", [], list(rows())).write(prepare_stem(tmp_path), gallery())
    assert sorted(tmp_path.iterdir()) == sorted(paths)
    assert {path.stem for path in paths} == {"report"}
