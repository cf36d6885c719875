"""The demonstration: a phantom, a broken disparity map, a real server, and pictures of what happened."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import numpy.typing as npt

from stereomend.api.server import passing_server
from stereomend.client import Client
from stereomend.codec import PREVIEW_TYPE, Span, colourise, encode_result
from stereomend.disparity import FloatMap, Image, Provenance, RefinementResult
from stereomend.evaluation.metrics import Scores, score
from stereomend.opencv import cv2
from stereomend.phantom import Phantom, break_disparity, make_phantom

SEED = 7
RUNS = (
    ("LDR alone, paper", {"preset": "paper", "stages": ["ldr"]}),
    ("released", {"preset": "released"}),
    ("paper", {"preset": "paper"}),
    ("robust", {"preset": "robust"}),
)

_PROVENANCE_COLOURS = {
    Provenance.KEPT: (68, 119, 170),
    Provenance.REFINED: (34, 136, 51),
    Provenance.FILLED: (238, 119, 51),
    Provenance.UNOBSERVED: (60, 60, 60),
}
_WORST_PX = 5  # errors are painted up to here
_CAPTION_PX = 28
_GAP_PX = 6


def run_demo(folder: Path) -> Path:
    """Refine one phantom through a server on a free port, print errors and timings, draw pictures.

    Args:
        folder: made where needed; pictures and maps are written into it.

    Returns:
        The picture that shows all others side by side.

    Raises:
        NotReady: the server did not start.
        OSError: the folder cannot be written.
    """
    phantom = make_phantom(SEED, instrument=True)
    upload = break_disparity(phantom, SEED).values
    with passing_server() as url, Client(url) as client:
        print(
            f"A phantom of {phantom.pair.shape[1]} x {phantom.pair.shape[0]} px, refined over HTTP by {url}\n"
        )
        _print_errors("network", score(upload, phantom.truth))
        for name, params in RUNS:
            result = client.refine(phantom.pair.left, phantom.pair.right, upload, **params)
            _print_errors(name, score(result.disparity, phantom.truth))
    print("\nmilliseconds of the last one: " + ", ".join(f"{k} {v:.1f}" for k, v in result.timings.items()))
    write_phantom(folder, phantom, upload)
    overview = _draw(folder, phantom, upload, result)
    print(f"pictures: {overview}")
    return overview


def _print_errors(name: str, errors: Scores) -> None:
    print(
        f"  {name:18s} RMSE {errors.rmse:6.2f} px   mean {errors.epe:6.2f} px   "
        f"over 3 px {errors.bad[3.0]:5.1f} %"
    )


def write_phantom(folder: Path, phantom: Phantom, network: FloatMap) -> None:
    """Write a phantom's pair, truth, masks, broken map and calibration into `folder` (raises OSError)."""
    folder.mkdir(parents=True, exist_ok=True)
    _write(folder / "left.png", phantom.pair.left)
    _write(folder / "right.png", phantom.pair.right)
    _write(folder / "occluded.png", phantom.occluded.astype(np.uint8) * 255)
    _write(folder / "instrument.png", phantom.instrument.astype(np.uint8) * 255)
    _write(folder / "truth.png", _sixteen_bit(phantom.truth))
    _write(folder / "network.png", _sixteen_bit(network))
    calibration = {"focal_px": phantom.focal_px, "baseline_mm": phantom.baseline_mm}
    (folder / "calibration.json").write_text(json.dumps(calibration, indent=1) + "\n")


def _draw(folder: Path, phantom: Phantom, upload: FloatMap, result: RefinementResult) -> Path:
    span = Span(float(phantom.truth.min()), float(phantom.truth.max()))
    pictures = {
        "network": colourise(upload, span),
        "error_before": _paint_error(upload, phantom.truth),
        "truth": colourise(phantom.truth, span),
        "provenance": _paint_provenance(result.provenance),
        "refined": colourise(result.disparity, span),
        "error_after": _paint_error(result.disparity, phantom.truth),
    }
    for name, picture in pictures.items():
        _write(folder / f"{name}_colour.png", picture)
    (folder / "refined_preview.png").write_bytes(encode_result(result, PREVIEW_TYPE))
    (folder / "refined.png").write_bytes(encode_result(result, "image/png"))
    overview = folder / "overview.png"
    views = (phantom.pair.left, phantom.pair.right)
    captions = (
        *("left", "right", "network's disparity", f"its error, 0 to {_WORST_PX} px"),
        *("true disparity", "where the result comes from", "refined", f"error, 0 to {_WORST_PX} px"),
    )
    _write(overview, _side_by_side(dict(zip(captions, (*views, *pictures.values()), strict=True)), columns=4))
    return overview


def _paint_provenance(provenance: npt.NDArray[np.uint8]) -> Image:
    colours = np.array([_PROVENANCE_COLOURS[kind] for kind in Provenance], np.uint8)
    picture = colours[provenance]
    for row, kind in enumerate(Provenance):
        at = (10, provenance.shape[0] - 12 - 22 * row)
        cv2.rectangle(picture, (at[0], at[1] - 12), (at[0] + 14, at[1] + 2), _PROVENANCE_COLOURS[kind], -1)
        cv2.rectangle(picture, (at[0], at[1] - 12), (at[0] + 14, at[1] + 2), (255, 255, 255), 1)
        _put_text(picture, kind.name.lower(), (at[0] + 22, at[1]))
    return picture


def _paint_error(disparity: FloatMap, truth: FloatMap) -> Image:
    levels = np.clip(np.abs(disparity - truth) / _WORST_PX * 255, 0, 255).astype(np.uint8)
    return np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_INFERNO)[..., ::-1], np.uint8)


def _side_by_side(panels: dict[str, Image], columns: int) -> Image:
    cells = [_captioned(name, panel) for name, panel in panels.items()]
    rows = [np.hstack(cells[i : i + columns]) for i in range(0, len(cells), columns)]
    return np.vstack(rows)


def _captioned(name: str, panel: Image) -> Image:
    cell = np.full((panel.shape[0] + _CAPTION_PX + _GAP_PX, panel.shape[1] + _GAP_PX, 3), 24, np.uint8)
    cell[_CAPTION_PX : _CAPTION_PX + panel.shape[0], : panel.shape[1]] = panel
    _put_text(cell, name, (6, 20))
    return cell


def _put_text(picture: Image, text: str, at: tuple[int, int]) -> None:
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.55, (255, 255, 255), 1, cv2.LINE_AA)


def _sixteen_bit(disparity: FloatMap) -> Image:
    """Disparity times 256, 0 where unknown: the form in which networks' maps come."""
    return np.rint(disparity * 256).astype(np.uint16)


def _write(path: Path, image: Image) -> None:
    stored = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    path.write_bytes(cv2.imencode(".png", stored)[1].tobytes())
