import pytest
from starlette.requests import Request

from stereomend.api.conditional import etag_of, has_already
from stereomend.api.idempotency import idempotency_key
from stereomend.api.preferences import Preferences
from stereomend.errors import MalformedRequest


def request(name, *values):
    headers = [(name.encode(), value.encode("latin-1")) for value in values]
    return Request({"type": "http", "headers": headers})


@pytest.mark.parametrize(
    ("given", "wait_s", "respond_async"),
    [
        ([], None, False),
        ([""], None, False),
        (["wait=10"], 10, False),
        (["WAIT = 10"], 10, False),
        (['wait="10"'], 10, False),
        (["wait=0"], 0, False),
        (["respond-async"], None, True),
        (["respond-async, wait=10"], 10, True),
        (["respond-async", "wait=10"], 10, True),
        (["wait=10; strictly, respond-async; foo"], 10, True),
        (["wait=10, wait=20"], 10, False),
        (['foo="a, wait=3", wait=4'], 4, False),
        (['foo="a\\", wait=3", wait=4'], 4, False),
        (["return=minimal, handling=lenient"], None, False),
        (["wait"], None, False),
        (["wait=ten"], None, False),
        (["wait=-1"], None, False),
        (["wait=1.5"], None, False),
        (["wait=\u00b2"], None, False),
        (["wait=" + "9" * 5000], None, False),
        ([', , "', "wait=1"], 1, False),
    ],
)
def test_preferences_are_read_and_what_is_broken_counts_as_not_given(given, wait_s, respond_async):
    assert Preferences.of(request("prefer", *given)) == (wait_s, respond_async)


@pytest.mark.parametrize(
    ("preferences", "patience_s", "applied"),
    [
        (Preferences(), None, None),
        (Preferences(wait_s=10), 10, "wait=10"),
        (Preferences(respond_async=True), 0, "respond-async"),
        (Preferences(wait_s=10, respond_async=True), 10, "respond-async, wait=10"),
    ],
)
def test_what_is_honoured_is_said(preferences, patience_s, applied):
    assert preferences.patience_s == patience_s
    assert preferences.applied.get("Preference-Applied") == applied


@pytest.mark.parametrize(
    ("given", "has"),
    [
        ([], False),
        (['"4"'], True),
        (['W/"4"'], True),
        (['"3", "4"'], True),
        (['"3"', '"4"'], True),
        (["*"], True),
        (['"14"'], False),
        (["4"], False),
        (['"4'], False),
        (['"3, 4"'], False),
    ],
)
def test_an_entity_tag_is_compared_weakly_and_as_a_whole(given, has):
    assert has_already(request("if-none-match", *given), '"4"') is has


def test_different_facts_have_different_tags():
    assert len({etag_of("a", "bc"), etag_of("ab", "c"), etag_of("abc"), etag_of("a", "bc ")}) == 4


def test_an_idempotency_key_is_taken_as_it_is():
    assert idempotency_key(request("x")) is None
    assert idempotency_key(request("idempotency-key", '"frame-17"')) == '"frame-17"'
    assert idempotency_key(request("idempotency-key", "~" * 255)) == "~" * 255


@pytest.mark.parametrize("given", [[""], ["two words"], ["x" * 256], ["\xe9"], ["a", "b"], ["a\x00"]])
def test_what_is_no_idempotency_key_is_malformed(given):
    with pytest.raises(MalformedRequest, match="Idempotency-Key"):
        idempotency_key(request("idempotency-key", *given))
