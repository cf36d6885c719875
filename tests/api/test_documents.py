"""What the API tells about itself."""

import re

import httpx
import numpy as np
import pytest
from openapi_schema_validator import OAS30Validator
from openapi_spec_validator import OpenAPIV30SpecValidator, validate

from stereomend.refinement import PRESETS, parse_params

ROUTES = {
    ("post", "/v1/refine"): "200 202 400 401 403 406 409 410 413 415 422 429 500 503 507",
    ("post", "/v1/jobs"): "200 202 400 401 403 409 413 415 422 429 500 503 507",
    ("get", "/v1/jobs"): "200 401 403 422 500 503",
    ("get", "/v1/jobs/{job_id}"): "200 304 401 403 404 500 503",
    ("delete", "/v1/jobs/{job_id}"): "204 401 403 404 500 503",
    ("get", "/v1/jobs/{job_id}/result"): "200 304 401 403 404 406 409 410 422 500 503",
    ("get", "/v1/jobs/{job_id}/events"): "200 204 401 403 404 500 503",
    ("post", "/v1/jobs/{job_id}/cancel"): "200 401 403 404 409 500 503",
    ("get", "/v1/presets"): "200 401 403",
    ("get", "/livez"): "200",
    ("get", "/readyz"): "200 503",
    ("get", "/metrics"): "200 401 403 503",
}


UNTOLD = ("/v1/presets", "/metrics", "/livez", "/readyz")
"""Their answers are short, or the page has them live."""


def check(openapi, schema, instance):
    """Validate as a client in any language would, with the document alone."""
    OAS30Validator(schema | {"components": openapi["components"]}).validate(instance)


@pytest.fixture
def openapi(server):
    return httpx.get(f"{server.url}/openapi.json").json()


def test_presets_can_be_sent_back_as_parameters(server):
    answer = httpx.get(f"{server.url}/v1/presets").json()
    assert answer["default"] in answer["presets"]
    assert answer["presets"].keys() == PRESETS.keys()
    for name, preset in answer["presets"].items():
        assert parse_params({"preset": name} | preset["params"]) == parse_params({"preset": name})


def test_the_schema_describes_every_parameter(server):
    schema = httpx.get(f"{server.url}/v1/presets").json()["schema"]
    for properties in (schema["properties"], *(part["properties"] for part in schema["$defs"].values())):
        for name, described in properties.items():
            assert described.get("description"), name


def test_every_reference_in_openapi_leads_somewhere(openapi):
    for reference in re.findall(r"'\$ref': '#/([^']+)'", str(openapi)):
        found = openapi
        for step in reference.split("/"):
            found = found[step]


def operations(openapi):
    return {(method, path): it for path, its in openapi["paths"].items() for method, it in its.items()}


def test_openapi_is_valid_and_of_a_version_that_the_page_draws(openapi):
    validate(openapi, cls=OpenAPIV30SpecValidator)


@pytest.mark.parametrize("route", ROUTES, ids=" ".join)
def test_openapi_names_every_answer(openapi, route):
    assert operations(openapi).keys() == ROUTES.keys()
    operation = operations(openapi)[route]
    assert operation["summary"]
    assert " ".join(sorted(operation["responses"])) == ROUTES[route]
    for status, response in operation["responses"].items():
        assert response["description"]
        if int(status) >= 400:
            assert list(response["content"]) == ["application/problem+json"]


def test_every_example_is_as_its_schema_says(openapi):
    seen = []
    for route, operation in operations(openapi).items():
        for status, response in operation["responses"].items():
            for kind, content in response.get("content", {}).items():
                if "example" in content:
                    check(openapi, content["schema"], content["example"])
                    seen.append((route, status))
                assert "json" not in kind or "example" in content or route[1] in UNTOLD, (route, status)
        for parameter in operation.get("parameters", []):
            if "example" in parameter["schema"]:
                check(openapi, parameter["schema"], parameter["schema"]["example"])
    assert len(seen) > 60


def test_examples_of_problems_have_the_status_they_stand_beside(openapi):
    for operation in operations(openapi).values():
        for status, response in operation["responses"].items():
            if int(status) >= 400:
                assert response["content"]["application/problem+json"]["example"]["status"] == int(status)


def test_openapi_offers_files_to_upload_and_lists_what_may_come_back(openapi):
    refine = openapi["paths"]["/v1/refine"]["post"]
    properties = refine["requestBody"]["content"]["multipart/form-data"]["schema"]["properties"]
    assert [name for name in properties if properties[name].get("format") == "binary"] == [
        "left",
        "right",
        "disparity",
        "mask",
    ]
    assert len(refine["responses"]["200"]["content"]) == 7


def test_the_documents_need_no_internet(server):
    page = httpx.get(f"{server.url}/docs").text
    assert not re.findall(r"https?://|//[a-z]", page)
    assets = re.findall(r'(?:src|href)="([^"]+)"', page)
    assert len(assets) == 3
    for asset in assets:
        assert httpx.get(server.url + asset).status_code == 200
    assert '"validatorUrl": null' in page


def test_real_answers_are_as_the_schemas_say(server, openapi, submit, finished, as_npy):
    submitted = submit(server)
    succeeded = finished(server, submitted)
    failed = finished(server, submit(server, right=as_npy(np.zeros((9, 9), np.uint8))))
    assert (succeeded["state"], failed["state"]) == ("succeeded", "failed")
    for job in (submitted.json(), succeeded, failed):
        check(openapi, {"$ref": "#/components/schemas/JobDocument"}, job)
    jobs = httpx.get(f"{server.url}/v1/jobs", params={"limit": 1}).json()
    check(openapi, {"$ref": "#/components/schemas/JobsDocument"}, jobs)
    problem = httpx.get(f"{server.url}/v1/jobs/0").json()
    check(openapi, {"$ref": "#/components/schemas/ProblemDocument"}, problem)
