"""The quality benchmark: its measures against brute force and hand-made numbers, and the command itself."""

import json
import math
import subprocess
import sys

import numpy as np
import pytest

from stereomend.bench import quality_methods
from stereomend.bench.quality_cases import ALL_CASES, ONE_OF_EACH, QualityCase, View, plan_cases
from stereomend.bench.quality_methods import joint_bilateral, methods_of, nearest_filled, variational
from stereomend.bench.quality_scores import EDGE_PX, Scored, edge_band, score_map
from stereomend.bench.quality_summary import summarise
from stereomend.disparity import DisparityMap, StereoPair
from stereomend.errors import InvalidParameter
from stereomend.phantom import DAMAGES, make_phantom
from stereomend.refinement import PRESETS

COLUMNS = 100
GROUPS = {"broken", "large", "instrument", "good-smooth", "good-blurred", "good-quantised", "good-exact"}
CASE = QualityCase("broken", "mixed", 3, View(90, 61, 9.0, instrument=True))


@pytest.fixture(scope="module")
def phantom():
    return CASE.phantom()


class TestCases:
    def test_every_group_and_every_damage_alone_is_among_them(self):
        cases = plan_cases(0, ALL_CASES)
        assert len(cases) == ALL_CASES >= 40
        assert len(set(cases)) == ALL_CASES
        assert {case.group for case in cases} == GROUPS
        assert {*DAMAGES, "mixed"} <= {case.damage for case in cases if case.group == "broken"}

    def test_few_cases_are_of_all_groups(self):
        assert {case.group for case in plan_cases(0, ONE_OF_EACH)} == GROUPS

    def test_more_cases_are_other_ones(self):
        cases = plan_cases(0, 3 * ALL_CASES)
        assert cases[:ALL_CASES] == plan_cases(0, ALL_CASES)
        assert len({(case.seed, case.damage) for case in cases}) == 3 * ALL_CASES

    def test_another_base_seed_gives_other_phantoms(self):
        seen, unseen = ({case.seed for case in plan_cases(seed, 1000)} for seed in (4, 5))
        assert not seen & unseen

    def test_large_disparities_lie_beyond_60_px_at_working_size(self):
        large = [case.view for case in plan_cases(0, ALL_CASES) if case.group == "large"]
        assert sum(view.max_disparity / 2 > 60 for view in large) >= len(large) / 2

    def test_a_case_gives_the_same_upload_again_and_good_maps_are_good(self):
        for case in plan_cases(0, ONE_OF_EACH, quick=True):
            phantom = case.phantom()
            upload = case.upload(phantom)
            assert upload.values.tobytes() == case.upload(case.phantom()).values.tobytes()
            off = np.mean(np.abs(upload.values - phantom.truth) > 3)
            assert (off < 0.01) == case.group.startswith("good-")


class TestScores:
    def test_the_truth_scores_0(self, phantom):
        scored = score_map(CASE, "exact", phantom.truth, phantom, 1.0)
        assert scored.rmse == scored.visible_rmse == scored.occluded_rmse == 0
        assert scored.bad3 == scored.edge_bad3 == 0

    def test_what_is_hidden_is_what_forward_mapping_finds(self, phantom):
        truth = phantom.truth.astype(np.float64)
        height, width = truth.shape
        hidden = np.zeros(truth.shape, bool)
        for y in range(height):
            landing = np.arange(width) - truth[y]
            for x in range(width):
                hidden[y, x] = landing[x] < 0 or (landing[x + 1 :] <= landing[x]).any()
        # Between two pixels that hide a third the rays see more than forward mapping does.
        assert np.mean(hidden == phantom.occluded) > 0.98
        assert hidden.mean() == pytest.approx(phantom.occluded.mean(), rel=0.15)

    def test_visible_and_hidden_errors_make_up_the_whole(self, phantom):
        noise = np.random.default_rng(1).normal(0, 3, phantom.truth.shape)
        refined = np.maximum(phantom.truth + noise * (1 + phantom.occluded), 0).astype(np.float32)
        scored = score_map(CASE, "noisy", refined, phantom, 1.0)
        share = phantom.occluded.mean()
        whole = (1 - share) * scored.visible_rmse**2 + share * scored.occluded_rmse**2
        assert scored.rmse**2 == pytest.approx(whole)
        assert scored.occluded_rmse > 1.5 * scored.visible_rmse

    def test_an_error_beside_the_instrument_counts_as_near_its_edge(self, phantom):
        band = edge_band(phantom.instrument)
        off = np.where(band, phantom.truth + 4, phantom.truth)
        scored = score_map(CASE, "off", off, phantom, 1.0)
        assert scored.edge_bad3 == 100
        assert scored.bad3 == pytest.approx(100 * band.mean())
        away = np.where(band, phantom.truth, phantom.truth + 4)
        assert score_map(CASE, "off", away, phantom, 1.0).edge_bad3 == 0

    def test_the_band_holds_what_is_within_5_px_of_the_other_side(self, phantom):
        shown = phantom.instrument
        inside, outside = np.argwhere(shown), np.argwhere(~shown)
        distance = np.hypot(*(inside[:, None] - outside[None]).transpose(2, 0, 1))
        expected = np.zeros_like(shown)
        expected[shown] = distance.min(axis=1) <= EDGE_PX
        expected[~shown] = distance.min(axis=0) <= EDGE_PX
        assert np.array_equal(edge_band(shown), expected)

    def test_without_an_instrument_nothing_is_near_its_edge(self):
        bare = make_phantom(1, 40, 32)
        assert score_map(CASE, "exact", bare.truth, bare, 1.0).edge_bad3 is None


def scored(case, method, rmse, edge=None, ms=1.0):
    return Scored(case, method, rmse, rmse, None, bad3=10 * rmse, edge_bad3=edge, ms=ms)


class TestSummaries:
    first, second, exact = (
        QualityCase(group, "mixed", seed, View(64, 48, 5.0))
        for group, seed in (("broken", 1), ("broken", 2), ("good-exact", 3))
    )

    def summaries(self, *scores):
        return {(one.group, one.method): one for one in summarise(scores)}

    def test_ratios_are_averaged_geometrically_against_the_input_of_the_same_case(self):
        found = self.summaries(
            scored(self.first, "input", 4.0),
            scored(self.first, "paper", 1.0, edge=30.0, ms=5.0),
            scored(self.second, "input", 1.0),
            scored(self.second, "paper", 4.0, ms=7.0),
        )["broken", "paper"]
        assert found.cases == 2
        assert found.ratio == pytest.approx(math.sqrt(1 / 4 * 4))
        assert (found.worst, found.worse) == (4.0, 1)
        assert found.rmse == found.visible_rmse == 2.5
        assert (found.bad3, found.edge_bad3, found.ms) == (25.0, 30.0, 6.0)
        assert found.occluded_rmse is None

    @pytest.mark.parametrize(("after", "worse"), [(2.09, 0), (2.11, 1)])
    def test_up_to_5_percent_is_no_harm(self, after, worse):
        scores = scored(self.first, "input", 2.0), scored(self.first, "paper", after)
        assert self.summaries(*scores)["broken", "paper"].worse == worse

    @pytest.mark.parametrize(("after", "worse"), [(0.009, 0), (0.3, 1)])
    def test_where_the_input_is_exact_the_error_itself_stands_for_the_ratio(self, after, worse):
        scores = scored(self.exact, "input", 0.0), scored(self.exact, "paper", after)
        found = self.summaries(*scores)
        assert found["good-exact", "paper"].ratio == pytest.approx(after)
        assert found["good-exact", "paper"].worse == worse
        assert found["good-exact", "input"].ratio == found["good-exact", "input"].worse == 0


class TestJointBilateral:
    rng = np.random.default_rng(5)

    def test_a_constant_map_stays_as_it_is(self):
        guide = self.rng.integers(0, 256, (23, 17, 3), np.uint8)
        flat = np.full(guide.shape[:2], 7.25, np.float32)
        assert joint_bilateral(flat, guide) == pytest.approx(flat, rel=1e-5)

    def test_an_edge_that_the_guide_shows_stays_and_noise_beside_it_goes(self):
        guide = np.zeros((30, 40, 3), np.uint8)
        guide[:, 20:] = 200
        clean = np.where(np.arange(40) < 20, 5.0, 25.0) * np.ones((30, 1))
        noisy = (clean + self.rng.normal(0, 0.5, clean.shape)).astype(np.float32)
        smooth = joint_bilateral(noisy, guide)
        assert np.abs(smooth - clean).max() < 0.5
        assert np.std(smooth - clean) < 0.2 * np.std(noisy - clean)

    @pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (3, 4), (14, 13)])
    def test_it_is_the_weighted_mean_that_a_plain_loop_gives(self, shape):
        guide = self.rng.integers(90, 130, (*shape, 3), np.uint8)
        values = self.rng.uniform(1, 40, shape).astype(np.float32)
        expected = np.array(
            [[self.mean_at(values, guide, y, x) for x in range(shape[1])] for y in range(shape[0])]
        )
        assert joint_bilateral(values, guide) == pytest.approx(expected, rel=1e-4)

    @staticmethod
    def mean_at(values, guide, y, x):
        rows, columns = np.indices(values.shape)
        near = np.maximum(abs(rows - y), abs(columns - x)) <= quality_methods.BILATERAL_RADIUS
        distance = np.hypot(rows - y, columns - x) / quality_methods.BILATERAL_SPACE
        colour = np.abs(guide.astype(int) - guide[y, x].astype(int)).sum(axis=-1)
        weight = near * np.exp(-(distance**2 + (colour / quality_methods.BILATERAL_COLOUR) ** 2) / 2)
        return (weight * values).sum() / weight.sum()


class TestOtherMethods:
    def test_holes_get_the_value_of_the_nearest_known_pixel(self):
        rng = np.random.default_rng(2)
        values = rng.permutation(np.arange(1, 19 * 27 + 1)).reshape(19, 27) * (
            rng.uniform(size=(19, 27)) < 0.1
        )
        filled = nearest_filled(DisparityMap.from_array(values))
        known = np.argwhere(values > 0)
        for y, x in np.ndindex(values.shape):
            (from_,) = np.argwhere(values == filled[y, x])
            nearest = np.hypot(*(known - (y, x)).T).min()
            assert np.hypot(*(from_ - (y, x))) <= 1.05 * nearest  # OpenCV's distances are approximate

    def test_variational_refinement_follows_the_pair_along_x_alone(self):
        y, x = np.mgrid[:64, :96].astype(np.float64)

        def texture(x):
            return 127 + 50 * np.sin(0.5 * x + 0.2 * y) + 50 * np.cos(0.23 * x - 0.4 * y)

        left, right = (
            np.repeat(texture(at)[..., None].round().astype(np.uint8), 3, axis=2) for at in (x, x + 6)
        )
        start = np.full((64, 96), 5.4, np.float32)
        refined = variational(start, StereoPair(left, right))
        assert np.abs(refined - 6)[8:-8, 16:-8].mean() < 0.1
        assert (start == np.float32(5.4)).all()

    def test_every_preset_is_among_the_methods(self):
        names = list(methods_of(PRESETS, {}))
        assert names == ["input", "filled", "median", "bilateral", "variational", *PRESETS]

    def test_an_unknown_parameter_is_refused_before_anything_runs(self):
        with pytest.raises(InvalidParameter, match=r"gdr\.warp"):
            methods_of(PRESETS, {"gdr": {"warp": 3}})

    def test_all_methods_take_a_map_with_one_known_pixel(self, phantom):
        lone = np.zeros_like(phantom.truth)
        lone[40, 50] = phantom.truth[40, 50]
        for method in methods_of(PRESETS, {}).values():
            refined = method(phantom.pair, DisparityMap.from_array(lone))
            assert refined.shape == phantom.truth.shape
            assert refined.dtype == np.float32
            assert np.isfinite(refined).all()


def bench(*arguments):
    command = [sys.executable, "-m", "stereomend", "bench", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def run_quick(folder, *arguments):
    file = folder / "quality.json"
    done = bench("--quality", "--quick", *arguments, "--json", file)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout, json.loads(file.read_text())


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    return run_quick(tmp_path_factory.mktemp("quality"))


def errors(report):
    return {(one["case"]["group"], one["method"]): one["rmse"] for one in report["scored"]}


class TestCommand:
    def test_the_table_has_all_groups_within_100_columns(self, quick):
        text, _ = quick
        for group in GROUPS:
            assert f"\n{group} (1)" in text
        assert [line for line in text.splitlines() if len(line) > COLUMNS] == []

    def test_the_file_holds_every_method_on_every_case(self, quick):
        _, report = quick
        methods = ["input", "filled", "median", "bilateral", "variational", *PRESETS]
        assert len(report["scored"]) == len(methods) * ONE_OF_EACH
        assert {(one["group"], one["method"]) for one in report["summaries"]} == set(errors(report))
        assert report["machine"]["cores"] >= 1
        assert report["plan"]["presets"] == list(PRESETS)
        view = {"width": 160, "height": 128, "max_disparity": 10.0, "instrument": False}
        assert report["scored"][0]["case"] == {"group": "broken", "damage": "mixed", "seed": 0, "view": view}

    def test_the_presets_mend_what_is_broken(self, quick):
        ratios = {(one["group"], one["method"]): one["ratio"] for one in quick[1]["summaries"]}
        for preset in PRESETS:
            assert ratios["broken", preset] < 0.5

    def test_an_override_changes_the_presets_and_nothing_else(self, quick, tmp_path):
        text, report = run_quick(
            tmp_path, "--preset", "paper", "--set", "gdr.warps=1", "--set", "gdr.levels=1"
        )
        assert "all presets with gdr.warps=1 gdr.levels=1" in text
        before, after = errors(quick[1]), errors(report)
        for (group, method), error in after.items():
            assert (error == before[group, method]) == (method != "paper")
        assert {method for _, method in after} == {
            "input",
            "filled",
            "median",
            "bilateral",
            "variational",
            "paper",
        }

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (("--quality", "--seed", "-1"), "stereomend: --seed -1: expected 0 to 1000000\n"),
            (("--quality", "--scenes", "0"), "stereomend: --scenes 0: expected 1 to 1000\n"),
            (("--quality", "--preset", "best"), "stereomend: preset: got 'best', expected one of "),
            (("--quality", "--set", "warps=1"), "stereomend: --set warps=1: expected ldr.NAME=VALUE or "),
            (("--quality", "--set", "gdr.warps=0"), "stereomend: gdr.warps: "),
            (("--quality", "--threads", "1"), "stereomend: --threads: not with --quality\n"),
            (("--scenes", "3"), "stereomend: --scenes: only with --quality\n"),
        ],
    )
    def test_bad_usage_is_one_line_and_code_2(self, arguments, message):
        done = bench("--quick", "--no-http", *arguments)
        assert done.returncode == 2
        assert done.stderr.startswith(message)
        assert done.stderr.count("\n") == 1
