"""What there is to write in a scenario file: the kinds of everything, and the JSON Schema for editors."""

from __future__ import annotations

from typing import Any, get_args

from twin.scenario.model import Scenario
from twin.sensors.presets import preset_files
from twin.validation import models_of


def kinds() -> dict[str, list[str]]:
    """Which kinds of terrain, machine, driver, implement, sensor and estimator there are."""
    sections = ("terrain", "machine", "driver", "implement", "sensors", "estimators")
    return {
        section: [
            get_args(model.model_fields["kind"].annotation)[0]
            for model in models_of(Scenario.model_fields[section].annotation)
        ]
        for section in sections
    }


def json_schema() -> dict[str, Any]:
    """JSON Schema of scenario files as people write them (with ``extends``, ``extra_checks`` and ``preset``)."""
    schema = Scenario.model_json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["properties"]["extends"] = {
        "type": "string",
        "description": "Name of a scenario in the same folder that this one changes.",
    }
    schema["properties"]["extra_checks"] = {
        **{key: value for key, value in schema["properties"]["checks"].items() if key in {"type", "items"}},
        "description": "Checks in addition to the inherited ones, which checks would replace.",
    }
    sensors = schema["properties"]["sensors"]
    preset = {
        "type": "object",
        "required": ["preset"],
        "properties": {"preset": {"enum": sorted(preset_files()), "description": "Preset that the other keys change."}},
    }
    sensors["additionalProperties"] = {"anyOf": [preset, sensors["additionalProperties"]]}
    return schema
