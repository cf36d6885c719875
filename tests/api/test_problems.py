"""The map from errors to statuses covers the tree."""

import asyncio
import logging

import httpx
import pytest

from stereomend import errors
from stereomend.api.app import create_app
from stereomend.api.problems import STATUSES, status_of
from stereomend.errors import StereomendError, error_from_slug
from stereomend.settings import load_settings


def tree(root=StereomendError):
    yield root
    for branch in root.__subclasses__():
        yield from tree(branch)


def get(app, path, **headers):
    """Ask an application whose workers are not started."""

    async def ask():
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return await client.get(path, headers=headers)

    return asyncio.run(ask())


def test_every_error_has_its_own_slug_and_title():
    kinds = list(tree())
    assert len({kind.slug for kind in kinds}) == len({kind.title for kind in kinds}) == len(kinds)


def test_every_slug_leads_back_to_its_error():
    for kind in tree():
        assert type(error_from_slug(kind.slug, "why")) is kind
    assert type(error_from_slug("of-the-future", "why")) is StereomendError


@pytest.mark.parametrize(
    ("kind", "statuses"),
    [
        (errors.InputError, range(400, 429)),
        (errors.Unavailable, (429, 500, 503, 507)),
        (errors.AccessDenied, (401, 403)),
    ],
)
def test_the_statuses_tell_whose_fault_it_was(kind, statuses):
    for error in tree(kind):
        assert status_of(error) in statuses


def test_the_map_names_errors_only():
    assert set(STATUSES) <= set(tree())


def test_an_unexpected_fault_is_a_problem_document_and_logged(caplog):
    app = create_app(load_settings(backend="reference", api_keys="of-a-test"))

    @app.get("/fault")
    async def fault():
        raise ZeroDivisionError("secret")

    with caplog.at_level(logging.ERROR):
        response = get(app, "/fault", Authorization="Bearer of-a-test")
    assert response.status_code == 500
    document = response.json()
    assert document["type"] == "/problems/internal-error"
    assert "secret" not in response.text
    assert document["request_id"] == response.headers["X-Request-ID"]
    assert document["request_id"] in caplog.text
    assert "ZeroDivisionError" in caplog.text


def test_before_the_workers_start_the_server_is_not_ready():
    response = get(create_app(load_settings(backend="reference")), "/readyz")
    assert response.status_code == 503
    assert response.json()["type"] == "/problems/not-ready"
    assert int(response.headers["Retry-After"]) >= 1
