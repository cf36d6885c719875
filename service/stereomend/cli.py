"""The command `stereomend`. Exit codes: 0 done, 2 bad usage or input, 1 failed."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stereomend import keys
from stereomend.errors import AccessDenied, ConfigurationError, InputError, InvalidParameter, StereomendError

if TYPE_CHECKING:
    from stereomend.disparity import RefinementResult

# Workers import the main module again: each command imports only what it needs.

_REFINE_EPILOG = """\
examples:
  stereomend refine left.png right.png network.png -o refined.png
  stereomend refine left.png right.png network.npy -o refined.npz --preset released --set gdr.warps=10
  stereomend refine left.png right.png -o refined.pfm --url http://127.0.0.1:8000
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; an error is one line on stderr."""
    options = _parser().parse_args(arguments)
    command: Callable[[argparse.Namespace], int] = options.command
    try:
        return command(options)
    except (InputError, ConfigurationError, AccessDenied) as error:
        return _failed(error, 2)
    except StereomendError as error:
        return _failed(error, 1)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        return _failed(f"{error.filename}: {error.strerror}" if error.filename else error, 2)
    except KeyboardInterrupt:
        return 130


def _failed(error: object, code: int) -> int:
    print(f"stereomend: {error}", file=sys.stderr)
    return code


def _parser() -> argparse.ArgumentParser:
    from importlib.metadata import version

    parser = argparse.ArgumentParser(prog="stereomend", description="Mends disparity maps of stereo pairs.")
    parser.add_argument("--version", action="version", version=f"stereomend {version('stereomend')}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_serve(commands.add_parser("serve", help="run the server"))
    _add_refine(
        commands.add_parser(
            "refine",
            help="refine one disparity map, here or on a server",
            epilog=_REFINE_EPILOG,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
    )
    _add_demo(
        commands.add_parser("demo", help="refine a phantom through a real server and draw what happened")
    )
    _add_phantom(
        commands.add_parser("phantom", help="write synthetic pairs with exact and with broken disparity")
    )
    _add_bench(
        commands.add_parser("bench", help="measure how fast this machine refines, or how good the maps are")
    )
    _add_evaluate(commands.add_parser("evaluate", help="score disparity maps on a dataset, raw and refined"))
    _add_doctor(commands.add_parser("doctor", help="say what this machine has, and what is missing"))
    keys.add_to(commands.add_parser("keys", help="make, list and revoke API keys"))
    return parser


def _add_serve(parser: argparse.ArgumentParser) -> None:
    from stereomend.settings import Settings

    for name, field in Settings.model_fields.items():
        default = "" if field.default in ((), None) else f" (default {field.default})"
        parser.add_argument(
            f"--{name.replace('_', '-')}", metavar=name.upper(), help=f"{field.description}{default}"
        )
    parser.epilog = (
        "Each is also STEREOMEND_<NAME> in the environment, or in the TOML file STEREOMEND_CONFIG names."
    )
    parser.set_defaults(command=_serve)


def _serve(options: argparse.Namespace) -> int:
    from stereomend.api.server import serve
    from stereomend.settings import Settings, load_settings

    return serve(load_settings(**{name: getattr(options, name) for name in Settings.model_fields}))


def _add_refine(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("left", type=Path, metavar="LEFT", help="left image: PNG, JPEG, TIFF, BMP, PNM or NPY")
    add("right", type=Path, metavar="RIGHT", help="right image, rectified with the left one")
    add(
        "disparity",
        type=Path,
        nargs="?",
        metavar="DISPARITY",
        help="16-bit PNG, NPY, PFM or TIFF; default: matched",
    )
    add("-o", "--output", type=Path, required=True, metavar="OUT", help=".png .npy .npz .pfm .tiff or .ply")
    add("--preset", help="set of parameters to start from")
    add("--stages", type=_list, help="ldr,gdr or one of them")
    add("--initial", help="upload, sgbm or zero")
    add(
        "--scale",
        dest="processing_scale",
        type=float,
        help="working size divided by input size (default 0.5)",
    )
    add("--disparity-scale", type=float, help="divisor of integer maps (default 256 for 16-bit PNG)")
    add("--mask", type=Path, metavar="PNG", help="one channel; 0 is not part of the scene")
    add(
        "--set",
        action="append",
        default=[],
        metavar="STAGE.NAME=VALUE",
        help="override, such as gdr.warps=10",
    )
    _add_calibration(parser)
    add("--backend", default="auto", help="auto, cuda, native or reference, for refining here")
    add("--url", help="refine on this server instead of here")
    add("--api-key", default=os.environ.get("STEREOMEND_API_KEY"), help="default: $STEREOMEND_API_KEY")
    add("--preview", type=Path, metavar="PNG", help="also write a colour picture")
    add("--timings", action="store_true", help="print the milliseconds of each stage")
    parser.set_defaults(command=_refine)


def _add_calibration(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--focal-px", type=float, help="focal length of the images [px]; with --baseline-mm gives depth")
    add("--baseline-mm", type=float, help="distance of the cameras [mm]")
    add("--cx", type=float, help="principal point's column [px] (default: the image centre)")
    add("--cy", type=float, help="principal point's row [px] (default: the image centre)")
    add("--doffs", type=float, help="cx of the right image minus cx of the left one [px] (default 0)")


def _list(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


def _refine(options: argparse.Namespace) -> int:
    from stereomend.codec import (
        PLY_TYPE,
        PREVIEW_TYPE,
        check_calibrated,
        decode_image,
        encode_result,
        media_type_for,
    )
    from stereomend.settings import load_settings

    media_type = media_type_for(options.output)
    check_calibrated(media_type, options.focal_px is not None)
    result = _refined_on_server(options) if options.url else _refined_here(options)
    left = None
    if media_type == PLY_TYPE:
        left = decode_image(options.left.read_bytes(), "left", load_settings().max_pixels)
    options.output.write_bytes(encode_result(result, media_type, left=left))
    if options.preview:
        options.preview.write_bytes(encode_result(result, PREVIEW_TYPE))
    _tell(options, result)
    return 0


def _refined_on_server(options: argparse.Namespace) -> RefinementResult:
    from stereomend.client import Client
    from stereomend.watching import refine_watched

    files = (options.left, options.right, options.disparity)
    with Client(options.url, options.api_key) as client:
        if sys.stderr.isatty():
            return refine_watched(client, files, options.mask, _params(options))
        return client.refine(*files, mask=options.mask, **_params(options))


def _refined_here(options: argparse.Namespace) -> RefinementResult:
    from stereomend.jobs.task import Files, refine_files
    from stereomend.refinement import parse_params, select_backend
    from stereomend.settings import load_settings

    params = parse_params(_params(options))
    disparity = options.disparity.read_bytes() if options.disparity else None
    mask = options.mask.read_bytes() if options.mask else None
    files = Files(options.left.read_bytes(), options.right.read_bytes(), disparity, mask=mask)
    return refine_files(files, params, select_backend(options.backend), load_settings().max_pixels).result


def _params(options: argparse.Namespace) -> dict[str, Any]:
    names = (
        *("preset", "stages", "initial", "processing_scale", "disparity_scale"),
        *("focal_px", "baseline_mm", "cx", "cy", "doffs"),
    )
    return _given(options, names) | _overrides(options.set)


def _given(options: argparse.Namespace, names: Sequence[str]) -> dict[str, Any]:
    """The options of these names that were given."""
    return {name: getattr(options, name) for name in names if getattr(options, name) is not None}


def _overrides(given: Sequence[str]) -> dict[str, dict[str, Any]]:
    """What `--set` gave, by stage."""
    overrides: dict[str, dict[str, Any]] = {}
    for override in given:
        path, equals, text = override.partition("=")
        stage, dot, name = path.partition(".")
        if not (equals and dot and stage in ("ldr", "gdr")):
            raise InvalidParameter(f"--set {override}: expected ldr.NAME=VALUE or gdr.NAME=VALUE")
        overrides.setdefault(stage, {})[name] = _value(text)
    return overrides


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def _tell(options: argparse.Namespace, result: RefinementResult) -> None:
    height, width = result.disparity.shape
    kinds = ("kept", "refined", "filled", "unobserved")
    shares = ", ".join(f"{kind} {result.quality[kind]:.0%}" for kind in kinds)
    made = f"{result.meta['preset']} on {result.meta['backend']}"
    print(f"{options.output}: {width} x {height} px, {made}: {shares}")
    for warning in result.quality["warnings"]:
        print(f"stereomend: warning: {warning}", file=sys.stderr)
    if options.timings:
        for stage, milliseconds in result.timings.items():
            print(f"  {stage:8s}{milliseconds:10.1f} ms")


def _add_demo(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("demo"), metavar="DIR", help="default: ./demo"
    )
    parser.add_argument("--open", action="store_true", help="show the overview when done")
    parser.set_defaults(command=_demo)


def _demo(options: argparse.Namespace) -> int:
    from stereomend.demo import run_demo

    overview = run_demo(options.output)
    if options.open:
        import webbrowser

        webbrowser.open(overview.resolve().as_uri())
    return 0


def _add_phantom(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="one folder per phantom is made in it"
    )
    add("--seed", type=int, default=0, help="of the first phantom (default 0)")
    add("--count", type=int, default=1, help="how many, with seeds counting up (default 1)")
    add(
        "--size", type=_size, default=(640, 512), metavar="WxH", help="of both images in px (default 640x512)"
    )
    add("--max-disparity", type=float, help="of the nearest point in px (default 6 %% of the width)")
    add("--instrument", action="store_true", help="let a shaft reach into the picture")
    parser.set_defaults(command=_phantom)


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    return int(width), int(height)


def _phantom(options: argparse.Namespace) -> int:
    from stereomend.demo import write_phantom
    from stereomend.phantom import break_disparity, make_phantom

    for seed in range(options.seed, options.seed + options.count):
        phantom = make_phantom(
            seed, *options.size, max_disparity=options.max_disparity, instrument=options.instrument
        )
        folder = options.output / f"phantom_{seed:04d}"
        write_phantom(folder, phantom, break_disparity(phantom, seed).values)
        print(folder)
    return 0


def _add_bench(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--size", type=_size, nargs="+", metavar="WxH", help="of the input in px; it is worked at half of it")
    add("--preset", nargs="+", help="default: all")
    add("--backend", nargs="+", help="cuda, native, reference; default: native")
    add("--threads", type=int, nargs="+", help="default: 1, 2 and all cores")
    add("--repeats", type=int, help="rounds, each with every configuration once (default 9)")
    add("--json", type=Path, metavar="FILE", help="write all figures, and what they were measured on")
    add("--http", action=argparse.BooleanOptionalAction, default=True, help="time requests to a server too")
    add("--quick", action="store_true", help="a few seconds: whether it works, not how fast or how good")
    add("--quality", action="store_true", help="score refined maps of phantoms instead, beside other methods")
    add("--seed", type=int, help="with --quality: base of all seeds (default 0)")
    add("--scenes", type=int, metavar="N", help="with --quality: cases, in turns over all groups")
    add(
        "--set",
        action="append",
        metavar="STAGE.NAME=VALUE",
        help="with --quality: override in all presets, such as gdr.warps=10",
    )
    parser.set_defaults(command=_bench)


_BENCH_SPEED = ("size", "backend", "threads", "repeats")
_BENCH_QUALITY = ("seed", "scenes", "set")


def _bench(options: argparse.Namespace) -> int:
    for name in _BENCH_SPEED if options.quality else _BENCH_QUALITY:
        if getattr(options, name) is not None:
            raise InvalidParameter(f"--{name}: {'not' if options.quality else 'only'} with --quality")
    return _bench_quality(options) if options.quality else _bench_speed(options)


def _bench_quality(options: argparse.Namespace) -> int:
    from stereomend.bench import quality_as_json, quality_lines_of, quality_plan_of, run_quality

    given = _given(options, ("seed", "scenes", "preset"))
    plan = quality_plan_of(given, _overrides(options.set or ()), quick=options.quick)
    report = run_quality(plan, _show_progress if sys.stderr.isatty() else lambda done, cases: None)
    print("\n".join(quality_lines_of(report)))
    if options.json:
        options.json.write_text(quality_as_json(report))
    return 0


def _show_progress(done: int, cases: int) -> None:
    """Keep one line of the terminal up to date; nothing is left of it in the end."""
    text = f"{done} of {cases} cases" if done < cases else ""
    print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)


def _bench_speed(options: argparse.Namespace) -> int:
    from stereomend.bench import as_json, lines_of, plan_of, run_bench

    given = _given(options, (*_BENCH_SPEED, "preset"))
    report = run_bench(plan_of(given, quick=options.quick, http=options.http))
    print("\n".join(lines_of(report)))
    if options.json:
        options.json.write_text(as_json(report))
    return 0


def _add_evaluate(parser: argparse.ArgumentParser) -> None:
    from stereomend.evaluation.arguments import add_arguments

    add_arguments(parser)
    parser.set_defaults(command=_evaluate)


def _evaluate(options: argparse.Namespace) -> int:
    from stereomend.evaluation.arguments import check_installed

    check_installed()
    from stereomend.evaluation.command import run_task, task_of
    from stereomend.evaluation.report import prepare_stem

    stem = prepare_stem(options.output) if options.output else None
    report, gallery = run_task(task_of(options))
    print(*report.write(stem, gallery), sep="\n") if stem else print(report.markdown(), end="")
    return 0


def _add_doctor(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(command=_doctor)


def _doctor(_: argparse.Namespace) -> int:
    from stereomend.doctor import examine

    findings = list(examine())
    width = max(len(finding.what) for finding in findings)
    for finding in findings:
        print(f"{'ok ' if finding.fine else 'no '} {finding.what:{width}s}  {finding.detail}")
    return 0 if all(finding.fine for finding in findings if finding.needed) else 1


if __name__ == "__main__":
    sys.exit(main())
