"""From the JSON Schema that pydantic writes to that of OpenAPI 3.0, which knows no null and one example."""

from __future__ import annotations

from typing import Any

_NULL = {"type": "null"}
_ONLY_NULL = {"type": "object", "nullable": True, "enum": [None]}


def as_openapi_30(node: Any) -> Any:
    """Rewrite a document and all schemas in it; examples are left as they are."""
    if isinstance(node, list):
        return [as_openapi_30(item) for item in node]
    if not isinstance(node, dict):
        return node
    node = {key: value if key == "example" else as_openapi_30(value) for key, value in node.items()}
    if isinstance(node.get("examples"), list):
        node["example"] = node.pop("examples")[0]
    return _nullable(node) if _NULL in _choices(node) else node


def _choices(node: dict[str, Any]) -> list[Any]:
    choices = node.get("anyOf", [])
    return choices if isinstance(choices, list) else []


def _nullable(node: dict[str, Any]) -> dict[str, Any]:
    others = [choice for choice in node["anyOf"] if choice != _NULL]
    rest = {key: value for key, value in node.items() if key != "anyOf"}
    if len(others) == 1 and "type" in others[0]:
        return {**others[0], **rest, "nullable": True}
    return rest | {"anyOf": [*others, _ONLY_NULL]}
