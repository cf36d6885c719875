import pytest

from stereomend.api.negotiation import choose
from stereomend.errors import NotAcceptable

PREVIEW = "image/png; profile=preview"
OFFERED = ("image/png", "application/x-npy", "image/tiff", PREVIEW)


@pytest.mark.parametrize(
    ("accept", "chosen"),
    [
        ("", "image/png"),
        ("*/*", "image/png"),
        ("image/*", "image/png"),
        ("application/*", "application/x-npy"),
        ("image/tiff", "image/tiff"),
        ("IMAGE/TIFF", "image/tiff"),
        ("image/png;profile=preview", PREVIEW),
        ('image/png; profile="preview"', PREVIEW),
        ("image/png; profile=preview; q=0.5", PREVIEW),
        ("image/tiff;q=0.5, application/x-npy;q=0.8", "application/x-npy"),
        ("application/x-npy, image/png", "application/x-npy"),
        ("text/html, */*;q=0.1", "image/png"),
        ("image/png;q=0, image/*", "image/tiff"),
        ("*/*, image/png;q=0.1", "application/x-npy"),
        ("nonsense, image/tiff", "image/tiff"),
    ],
)
def test_the_best_liked_offer_is_chosen(accept, chosen):
    assert choose(accept, OFFERED) == chosen


@pytest.mark.parametrize(
    "accept",
    [
        "text/html",
        "image/png;q=0",
        "*/*;q=0",
        "image/png;profile=other",
        "image/png;q=nan",
        "image/png;q=2",
        "*",
    ],
)
def test_what_nobody_offers_is_not_acceptable(accept):
    with pytest.raises(NotAcceptable, match="image/tiff"):
        choose(accept, OFFERED)
