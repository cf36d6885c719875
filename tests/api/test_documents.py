"""What the API tells about itself."""

import re

import httpx
import pytest

from stereomend.refinement import PRESETS, parse_params

ANSWERS = ["200", "400", "401", "403", "406", "413", "415", "422", "429", "500", "503"]


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


def test_openapi_names_every_route_and_answer(openapi):
    assert openapi["openapi"].startswith("3.0")
    assert openapi["paths"].keys() == {"/v1/refine", "/v1/presets", "/livez", "/readyz", "/metrics"}
    for path in openapi["paths"].values():
        for operation in path.values():
            assert operation["summary"]
            assert all(response["description"] for response in operation["responses"].values())


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
    assert set(refine["responses"]) == set(ANSWERS)
    for status, response in refine["responses"].items():
        assert status == "200" or list(response["content"]) == ["application/problem+json"]


def test_the_documents_need_no_internet(server):
    page = httpx.get(f"{server.url}/docs").text
    assert not re.findall(r"https?://|//[a-z]", page)
    assets = re.findall(r'(?:src|href)="([^"]+)"', page)
    assert len(assets) == 3
    for asset in assets:
        assert httpx.get(server.url + asset).status_code == 200
    assert '"validatorUrl": null' in page
