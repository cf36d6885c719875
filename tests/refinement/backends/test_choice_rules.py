"""The rules of R10 one by one: which share of the upload comes of what is told of two maps."""

import numpy as np
import pytest

from stereomend.refinement import parse_params, select_backend
from stereomend.refinement.backends import ChoiceRule, Grounds, Rivals

NATIVE, REFERENCE = select_backend("native", threads=2), select_backend("reference")
pytestmark = pytest.mark.parametrize("backend", [NATIVE, REFERENCE], ids=lambda backend: backend.name)
FUSION = parse_params({"preset": "robust"}).fusion
RULE = ChoiceRule.of(FUSION, 0.75, 0)
SIZE = 24, 48
X = np.arange(SIZE[1])
UNSEEN = np.broadcast_to(X >= 20, SIZE)
"""Where GDR sees nothing, in the tests of what can be reached."""


def told(size=SIZE, **changes):
    """Two maps that agree, are shown everywhere and trusted, but for the changes."""
    values = {"upload": 5, "valid": True, "u": 5, "for_upload": 0.6, "for_u": 0.6, "upload_shown": True}
    values |= {"u_shown": True, "level": 1, "equal": 1, "usual": 0.6, "edge": 1, "glints": False}
    values |= {"beside": False} | changes
    planes = {name: np.array(np.broadcast_to(value, size)) for name, value in values.items()}
    planes = {k: plane if plane.dtype == bool else plane.astype(np.float32) for k, plane in planes.items()}
    return (kind(*(planes[name] for name in kind._fields)) for kind in (Rivals, Grounds))


def unseen(backend, upload, rule=RULE, **changes):
    """The share where GDR sees nothing right of a part where both are `u`."""
    changes = {"u_shown": ~UNSEEN} | changes
    return backend.choose(*told(upload=upload, **changes), rule)


def test_where_both_agree_the_share_is_what_is_equal(backend):
    """Whatever the evidence of the pixel, and how high the trust is."""
    rng = np.random.default_rng(1)
    equal, n, other, level = rng.random((4, *SIZE)).astype(np.float32)
    apart = rng.uniform(-0.99, 0.99, SIZE) * RULE.near
    rivals, grounds = told(u=5 + apart, for_u=n, for_upload=other, equal=equal, level=level)
    assert (backend.choose(rivals, grounds, RULE) == equal).all()
    hidden = rng.random(SIZE) < 0.5
    found = backend.choose(rivals._replace(upload_shown=hidden), grounds._replace(beside=hidden), RULE)
    assert (found == equal).all()


@pytest.mark.parametrize(
    ("level", "margin"),
    [
        (0.8, FUSION.win_margin),
        (RULE.full_trust, FUSION.win_margin),
        ((RULE.full_trust + RULE.high_trust) / 2, (FUSION.win_margin - FUSION.trusted_margin) / 2),
        (RULE.high_trust, -FUSION.trusted_margin),
        (1, -FUSION.trusted_margin),
    ],
)
def test_where_they_differ_an_untrusted_upload_needs_more_evidence_and_a_trusted_one_may_lack_some(
    backend, level, margin
):
    for upload in (9, 1):
        for lead, share in ((margin - 0.005, 0), (margin + 0.005, 1)):
            facts = told(upload=upload, level=level, for_upload=0.6 + lead)
            assert (backend.choose(*facts, RULE) == share).all(), (upload, lead)


def test_the_evidence_of_5_x_5_pixels_decides_mirrored_at_borders(backend):
    """A lead of one pixel that is just enough for 25, at a corner for more: there it counts four times."""
    lead = np.zeros(SIZE)
    lead[12, 20] = lead[0, 0] = 25 * 0.03
    found = backend.choose(*told(upload=9, level=0.8, for_upload=0.6 + lead), RULE)
    expected = np.zeros(SIZE)
    expected[10:15, 18:23] = expected[:3, :3] = 1
    assert (found == expected).all()
    lead /= 2.5  # enough only where it counts twice or more
    found = backend.choose(*told(upload=9, level=0.8, for_upload=0.6 + lead), RULE)
    expected[:], expected[:2, :3], expected[:3, :2] = 0, 1, 1
    assert (found == expected).all()


def test_without_trust_no_other_map_counts(backend):
    """Neither by evidence nor by being reached; up to the middle between the least and full trust."""
    for level, share in ((0.78, 0), (0.79, 1)):
        assert (backend.choose(*told(upload=9, level=level, for_upload=1), RULE) == share).all()
        assert (unseen(backend, 5, level=level)[UNSEEN] == share).all()
    assert not backend.choose(*told(upload=9, level=0.5, for_upload=1), RULE._replace(enough=0.5)).any()


SURFACES = {
    "level": (5 + 0 * X, 1),
    "a small step": (np.where(X < 20, 5, 5.75), 1),
    "small steps": (5 + 0.75 * ((X - 18).clip(0) // 2), 1),
    "a slope": (5 + 0.75 * (X - 19).clip(0), 1),
    "a steep slope": (5 + 2 * (X - 19).clip(0, 11), 1),
    "a steep fall": (40 - 2 * (X - 19).clip(0, 11), 0),  # most of it left of the frame
    "a jump": (np.where(X < 20, 5, 12), 0),
    "a drop": (np.where(X < 20, 12, 5), 0),
    "stairs": (5 + 2 * ((X - 18).clip(0) // 2), 0),
}


@pytest.mark.parametrize("name", SURFACES)
def test_steps_and_straight_slopes_are_reached_and_jumps_only_across_colour_edges(backend, name):
    upload, share = SURFACES[name]
    found = unseen(backend, upload, u=np.where(UNSEEN, 1, upload))
    assert (found[~UNSEEN] == 1).all()
    assert (found[UNSEEN] == share).all()
    for edge, across in ((0.76, share), (0.74, 1)):
        found = unseen(backend, upload, u=np.where(UNSEEN, 1, upload), edge=edge)
        assert (found[UNSEEN] == across).all()


def test_a_colour_edge_on_either_side_of_a_jump_is_enough(backend):
    for soft, share in ((18, 0), (19, 1), (20, 1), (21, 0)):
        found = unseen(backend, np.where(UNSEEN, 12, 5), edge=np.where(soft == X, 0.4, 1))
        assert (found[UNSEEN] == share).all()


def test_a_slope_is_straight_only_as_far_as_the_right_image_shows_its_match(backend):
    """5 + 2 (x - 19) is x at 33: the last straight pixel, and the last that one can step from."""
    found = unseen(backend, 5 + 2 * (X - 19).clip(0), u=5)
    assert (found == (X <= 34)).all()
    shifted = 48 + 2 * (X - 19).clip(0)
    assert (unseen(backend, shifted, u=48) == ~UNSEEN).all()


def test_a_slope_down_the_picture_is_straight_too(backend):
    """Row by row 2 px more, from row 12 on; straight only where its match is shown, x >= u."""
    rows = np.arange(SIZE[0])[:, None]
    upload = np.broadcast_to(5 + 2 * (rows - 11).clip(0), SIZE)
    found = unseen(backend, upload, u=5, u_shown=rows < 12)
    reached = np.where(rows == 12, upload <= X, np.roll(upload, 1, axis=0) <= X)
    assert (found == ((rows < 12) | reached)).all()


def test_what_lies_round_one_corner_is_reached_and_round_many_where_neither_map_is_shown(backend):
    """Along rows, then columns; so run hidden surfaces that cross the picture aslant."""
    rows = np.arange(SIZE[0])[:, None]
    treads, risers = rows // 4 == X // 4 - 5, (X % 4 == 0) & (rows // 4 == X // 4 - 6)
    stairs = treads | risers | ((rows == 0) & (X < 20))
    seen, free = np.broadcast_to(X < 20, SIZE), RULE._replace(rough_share=1)
    facts = {"valid": stairs, "u_shown": seen}
    assert (unseen(backend, 5, rule=free, upload_shown=stairs & seen, **facts) == stairs).all()
    once = stairs & (X <= 24) & (rows < 8)
    found = unseen(backend, 5, rule=free, upload_shown=stairs, **facts)
    assert (found == once).all()


def between(middle):
    """Two surfaces that GDR sees, 5 and 20 px, with something in the 5 columns of `middle` between them."""
    upload = np.where(X < 22, 5.0, 20.0)
    upload[20:25] = middle
    return upload, np.broadcast_to((X < 20) | (X >= 25), SIZE)


SMEARED = {
    "a blurred edge": ([6, 9, 12.5, 16, 19], 1),
    "stairs": ([5, 5, 12, 12, 20], 1),
    "higher than both": ([6, 9, 21, 16, 19], 0),
    "lower than both": ([4, 9, 12, 16, 19], 0),
    "up, down and up": ([6, 16, 9, 12, 19], 0),
}


@pytest.mark.parametrize("name", SMEARED)
@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("turned", [False, True])
def test_what_leads_from_one_surface_to_another_only_up_or_only_down_is_believed(backend, name, way, turned):
    """Left of the right image's frame, where no slope counts as straight."""
    middle, share = SMEARED[name]
    upload, seen = between(middle)
    upload, shown = (np.broadcast_to(plane, SIZE)[:, ::way] for plane in (upload + 40, seen))
    u = np.where(shown, upload, 1)
    planes = [np.ascontiguousarray(plane.T if turned else plane) for plane in (upload, u, shown)]
    facts = told(planes[0].shape, upload=planes[0], u=planes[1], u_shown=planes[2], upload_shown=planes[2])
    found = backend.choose(*facts, RULE._replace(rough_share=1))
    assert (found[planes[2]] == 1).all()
    assert (found[~planes[2]] == share).all()


@pytest.mark.parametrize("map_shown", ["u_shown", "upload_shown"])
def test_no_bridge_leads_over_what_a_map_shows_or_to_a_small_patch(backend, map_shown):
    upload, seen = between([6, 9, 12.5, 16, 19])
    facts = {"upload": upload + 40, "u": np.where(seen, upload + 40, 1), "for_u": np.where(seen, 0.6, 0)}
    facts |= {"u_shown": seen, "upload_shown": seen}
    free = RULE._replace(rough_share=1)
    assert backend.choose(*told(**facts), free).all()
    assert (backend.choose(*told(**facts), free._replace(largest_patch=8 * 20 * SIZE[0])) == (X >= 25)).all()
    facts[map_shown] = seen | (X == 22)
    assert (backend.choose(*told(**facts), free) == seen).all()


def test_a_fold_of_exactly_the_step_is_straight_and_a_sharper_one_is_not(backend):
    """A slope of 1.25 px that turns by so much at every pixel, up and down."""
    rule = RULE._replace(step=0.75)
    for turn, share in ((0.75, 1), (0.875, 0)):
        upload = 5 + np.cumsum((UNSEEN[0] & (X < 31)) * (1.25 + turn * (X % 2)))
        assert (upload <= X)[20:].all()
        assert (unseen(backend, upload, rule, u=5)[:, 20:31] == share).all()


SPIKES = [(5, 23), (5, 37), (19, 23), (19, 37), (12, 25), (12, 35), (8, 30), (16, 30), (10, 27), (14, 33)]
"""Ten that only the window of 15 x 15 pixels around (12, 30) holds all of."""


def marked(places, size=SIZE):
    flags = np.zeros(size, bool)
    flags[tuple(np.transpose(places))] = True
    return flags


@pytest.mark.parametrize("height", [0.5, -0.5])
def test_more_than_nine_spikes_in_225_pixels_make_it_rough(backend, height):
    centre = marked([(12, 30)])
    assert (unseen(backend, 5 + height * marked(SPIKES)) == ~centre).all()
    assert (unseen(backend, 5 + height * marked(SPIKES[1:])) == 1).all()
    # No higher than the limit.
    assert (unseen(backend, 5 + height * marked(SPIKES), RULE._replace(spike=0.5)) == 1).all()
    assert (backend.choose(*told(upload=5 + height * marked(SPIKES)), RULE) == 1).all()  # u is seen: no walk


@pytest.mark.parametrize(("jump", "rough"), [(8, True), (12, False)])
def test_the_foot_of_a_jump_is_no_spike_though_the_surface_rises_from_it(backend, jump, rough):
    """A valley of one row, 0.5 px deep on its other side: as far up to both sides it would be spikes."""
    y = np.arange(SIZE[0])[:, None] - 11
    valley = 20 + np.where(y < 0, jump, 0.5 * y.clip(0, 2))
    found = unseen(backend, np.broadcast_to(valley, SIZE), u=20, usual=2.0)
    assert (found[9:14, 30:].max() == 0) == rough


def test_holes_make_it_rough_as_spikes_do_and_are_never_the_uploads(backend):
    holes, spikes = marked(SPIKES[:5]), marked(SPIKES[5:])
    found = unseen(backend, np.where(holes, 0, 5 + 0.5 * spikes), valid=~holes)
    assert (found == ~(holes | marked([(12, 30)]))).all()
    fewer = marked(SPIKES[1:5])
    found = unseen(backend, np.where(fewer, 0, 5 + 0.5 * spikes), valid=~fewer)
    assert (found == ~fewer).all()


def test_at_a_corner_only_the_pixels_inside_the_picture_count(backend):
    """Three spikes: over 0.04 of the 64 or 72 pixels around the last ones, not of 80 further inside."""
    spikes = marked([(0, 41), (2, 45), (7, 43)])
    assert (unseen(backend, 5 + 0.5 * spikes) == ~marked([(0, 47), (0, 46), (1, 47)])).all()


@pytest.mark.parametrize("reason", ["weak", "glint", "beside", "hidden"])
def test_where_u_sees_nothing_that_counts_the_upload_is_what_can_be_reached(backend, reason):
    """The evidence of the upload would lose; `beside` what a highly trusted upload hides it is not asked."""
    there = (X >= 20) & (X < 30)
    changes = {
        "weak": {"for_u": 0.47, "for_upload": 0},
        "glint": {"glints": UNSEEN, "for_upload": 0},
        "beside": {"beside": UNSEEN, "for_upload": 0},
        "hidden": {"beside": UNSEEN, "upload_shown": ~UNSEEN, "for_upload": 0},
    }[reason]
    facts = dict(upload=np.where(there, 5.5, 9 * UNSEEN + 5), u=np.where(there, 9, 5), **changes)
    found = backend.choose(*told(**facts), RULE)
    assert (found == (X < 30)).all()
    seen = {"weak": {"for_u": 0.49}, "glint": {"glints": False}}.get(reason, {"level": 0.8})
    assert (backend.choose(*told(**facts | seen), RULE) == ~UNSEEN).all()


STEP = np.where(X < 24, 20.0, 6.0)
"""The right edge of something near, in columns 23 and 24."""
SMEARING = {
    "over the jump": (STEP, [19, 14, 10, 7], 1),
    "over a jump up": (STEP[::-1], [7, 10, 14, 19], 1),
    "close to one side": (STEP, [20, 19, 7, 6], 1),
    "nearer than both": (STEP, [25, 24, 23, 22], 0),
    "farther than both": (STEP, [3, 3, 4, 4], 0),
    "what is sharp, where the upload is smeared": (np.interp(X, [20, 27], [20, 6]), [20, 20, 6, 6], 0),
}


@pytest.mark.parametrize("name", SMEARING)
@pytest.mark.parametrize("turned", [False, True])
def test_a_map_that_leads_over_a_jump_of_a_highly_trusted_upload_has_no_evidence(backend, name, turned):
    """It is free to fit the mixed pixels of the edge; u in columns 22 to 25 is given."""
    upload, over, share = SMEARING[name]
    u = np.where(X < 24, upload[0], upload[-1])
    u[22:26] = over
    differ = np.abs(u - upload) >= RULE.near
    maps = [np.broadcast_to(plane, SIZE) for plane in (upload, u)]
    maps = [plane.T if turned else plane for plane in maps]
    facts = dict(zip(("upload", "u"), maps, strict=True), for_upload=np.where(maps[0] == maps[1], 0.6, 0.2))
    for level, expected in ((0.86, share), (0.84, 0)):
        found = backend.choose(*told(maps[0].shape, **facts, level=level), RULE)
        assert ((found.T if turned else found)[:, differ] == expected).all(), level


def test_a_jump_is_looked_for_4_px_around_and_not_where_the_upload_is_unknown(backend):
    upload = np.broadcast_to(np.where(X < 30, 6.0, 20), SIZE)
    for x, share in ((26, 1), (25, 0)):
        u = np.where(marked([(12, x)]), 10, upload)
        assert backend.choose(*told(upload=upload, u=u, for_upload=0.2), RULE)[12, x] == share
    known, u = np.broadcast_to(X != 22, SIZE), np.where(marked([(12, 24)]), 6, 12)
    facts = told(upload=12 * known, valid=known, upload_shown=known, u=u, for_upload=0.2)
    assert backend.choose(*facts, RULE._replace(rough_share=1))[12, 24] == 0


def test_high_trust_lets_the_upload_hide_what_u_sees(backend):
    """Where the right image does not show the upload, it is believed if reached and if it lacks little."""
    rule = RULE._replace(full_trust=0.5, high_trust=0.75, enough=0.4)
    for lead, level, share in ((0.4, 0.75, 1), (-0.17, 0.75, 1), (-0.19, 0.75, 0), (0.4, 0.74, 0)):
        facts = told(u=1 + 4 * ~UNSEEN, upload_shown=~UNSEEN, for_upload=0.6 + lead, level=level)
        found = backend.choose(*facts, rule)
        assert (found[:, 20:] == share).all(), (lead, level)
        assert (found[:, :20] == 1).all()


@pytest.mark.parametrize(
    ("there", "passes"),
    [
        ({"u": 1, "for_upload": 0.3}, False),  # the pair contradicts the upload
        ({"u": 1, "for_upload": 0.5}, True),
        ({"u": 5.5, "for_upload": 0.3}, True),  # both say nearly the same
        ({"u": 1, "for_upload": 0.3, "glints": True}, True),
        ({"u": 1, "for_upload": 0.9, "upload_shown": False, "level": 0.84}, False),
        ({"u": 1, "for_upload": 0.9, "upload_shown": False, "level": 0.86}, True),
        ({"u_shown": False, "level": 0.7}, False),
        ({"u_shown": False, "valid": False, "upload": 0}, False),
    ],
)
def test_no_walk_leads_through_what_the_pair_contradicts(backend, there, passes):
    """A strip of 7 columns before what u does not see."""
    strip, rule = (X >= 20) & (X < 27), RULE._replace(rough_share=1)
    facts = {"u_shown": X < 27, "upload": 5, "u": 5, "for_upload": 0.6, "upload_shown": True, "level": 1}
    facts |= {"glints": False, "valid": True}
    facts = {k: np.where(strip, there.get(k, v), v) for k, v in facts.items()}
    facts["u_shown"] = np.where(strip, there.get("u_shown", True), X < 27)
    assert (backend.choose(*told(**facts), rule)[:, 27:] == passes).all()


def test_walks_start_only_where_both_are_shown_agree_and_are_trusted(backend):
    untrusted = np.where(UNSEEN, 1, 0.6)
    for change in ({"upload_shown": UNSEEN}, {"u_shown": False}, {"u": 5 + RULE.near}, {"level": untrusted}):
        facts = {"u_shown": ~UNSEEN} | change
        assert not backend.choose(*told(**facts), RULE)[UNSEEN].any(), change


def test_where_u_is_not_shown_the_share_is_what_is_reached(backend):
    """By the walk of `Backend.reach`, when nothing is contradicted or rough."""
    rng = np.random.default_rng(2)
    size, rule = (60, 150), RULE._replace(rough_share=1)
    upload = (rng.integers(0, 4, size) * 0.5 + 3 * (rng.random(size) < 0.3)).astype(np.float32) + 160
    u_shown, edge = rng.random(size) < 0.3, np.where(rng.random(size) < 0.3, 0.4, 1)
    seeds = u_shown & (upload == 160.5)
    u = np.where(seeds, upload, 100)
    facts = told(size, upload=upload, u=u, u_shown=u_shown, edge=edge, for_u=0, level=0.8)
    found = backend.choose(*facts, rule)
    walked = backend.reach(seeds, np.ones(size, bool), edge < 0.5, upload, rule.step)
    assert (found == walked).all()
    assert 0.2 < found.mean() < 0.98


@pytest.mark.parametrize(("against", "first", "level"), [(np.s_[:0], 12, 1), (np.s_[4:7, 8], 9, 0.8)])
def test_small_patches_are_dropped_however_well_they_compare(backend, against, first, level):
    """Of up to so many pixels that nothing contradicts, cut out by steps of 1 px. Corners count 4 times."""
    upload, n = np.full(SIZE, 5.0), np.full(SIZE, 0.6)
    parts = [np.s_[4:7, 8:12], np.s_[12:15, 8:13], np.s_[20:, 44:]]
    upload[4:7, 8:12] = upload[12:15, 8:13] = upload[20:, 44:] = 6
    u = upload.copy()
    u[against], n[against] = 12, 0.1
    for largest, dropped in ((first - 1, 0), (first, 1), (15, 2), (63, 2), (64, 3)):
        expected = np.ones(SIZE)
        for part in (against, *parts[:dropped]):
            expected[part] = 0
        facts = told(upload=upload, u=u, for_upload=n, level=level)
        assert (backend.choose(*facts, RULE._replace(largest_patch=largest)) == expected).all()


def test_a_steep_slope_is_one_patch_and_stairs_are_many(backend):
    """Each column differs from the next by over the step; a colour edge joins nothing."""
    column = RULE._replace(largest_patch=8 * SIZE[0])  # as the frame cuts off the outermost on three sides
    for upload, share in ((1 + 0.9 * (X - 4).clip(0), 1), (50 + 2 * X, 0), (5 + 3 * (X % 2), 0)):
        for edge in (1, 0.1):
            found = backend.choose(*told(upload=upload, u=upload, edge=edge), column)
            # The last column has no second difference along its rows, and joins whatever is beside it.
            assert (found[:, :-2] == share).all(), upload
