"""The arguments of `stereomend evaluate`; imports nothing that only evaluating needs."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path

from stereomend.errors import ConfigurationError

_EXTRA = ("scipy", "jinja2")

EPILOG = """\
predictions: DIR/METHOD/FRAME.png (16 bits, disparity times 256), .npy, .pfm or .tiff (px). FRAME is
  serv-ct     Experiment_1/001       scared     dataset_1/keyframe_2 (rectified: see the README)
  kitti       000000_10              sceneflow  TRAIN/A/0000/0006
  middlebury  the scene's folder     phantom    phantom_0000
or the same with _ for its slashes.

examples:
  stereomend evaluate serv-ct SERV-CT --predictions maps -o report
  stereomend evaluate kitti data_scene_flow --predictions maps --presets paper --stages ldr ldr,gdr
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments to a parser."""
    parser.epilog = EPILOG
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    add = parser.add_argument
    add("dataset", metavar="DATASET", help="serv-ct, scared, middlebury, kitti, sceneflow or phantom")
    add("root", type=Path, metavar="ROOT", help="the folder it was unpacked into")
    add("--predictions", type=Path, required=True, metavar="DIR", help="one folder of maps per method")
    add("--presets", nargs="+", metavar="P", help="to refine with (default: all)")
    add("--stages", nargs="+", metavar="S", help="variants of each preset: ldr, gdr, ldr,gdr (default: both)")
    add("--backend", default="auto", help="auto, native or reference")
    add("--pictures", type=int, default=8, metavar="N", help="frames shown in the page (default 8)")
    add(
        "-o",
        "--output",
        type=Path,
        metavar="REPORT",
        help="write REPORT.md, .csv and .html, or into the folder REPORT (default: Markdown on stdout)",
    )


def check_installed() -> None:
    """Refuse to start where a package is missing (raises ConfigurationError)."""
    missing = [name for name in _EXTRA if find_spec(name) is None]
    if missing:
        raise ConfigurationError(
            f"evaluate needs {' and '.join(missing)}: pip install 'stereomend[evaluate]'"
        )
