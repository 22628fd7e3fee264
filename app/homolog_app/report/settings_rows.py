"""Every setting and version of a result and its studies, for the table that repeats them."""

from collections.abc import Iterator

from pydantic import BaseModel

from homolog.files.records import ResultRecord
from homolog_app.report.study import Study

__all__ = ["settings_rows", "values_of"]

_NOT_GIVEN = {"core_set": "none", "segment": "none", "pairs": "none", "label": "all above 0"}
"""What settings are that are not given; others are then chosen by the program."""


def values_of(settings: BaseModel) -> Iterator[tuple[str, str]]:
    """Yield the name and the value, with its unit, of each setting."""
    for name, value in settings.model_dump(mode="json").items():
        extra = type(settings).model_fields[name].json_schema_extra
        unit = f" {extra['unit']}" if isinstance(extra, dict) and "unit" in extra else ""
        if value is None:
            yield name, _NOT_GIVEN.get(name, "automatic")
        elif isinstance(value, bool):
            yield name, "yes" if value else "no"
        elif isinstance(value, list):
            yield name, ", ".join(map(str, value)) or "none"
        else:
            yield name, f"{value}{unit}"


def settings_rows(record: ResultRecord, studies: list[Study]) -> list[tuple[str, str, str]]:
    """Return every setting and version: part, name, value."""
    rows = [
        (part, name, value)
        for part, model in (("groom", record.settings.groom), ("optimize", record.settings.optimize))
        for name, value in values_of(model)
    ]
    rows += [("run", "alignment by particles", record.settings.placing.procrustes.value)]
    rows += [("run", "device", record.device), ("run", "fingerprint", record.fingerprint)]
    for study in studies:
        rows += [
            (study.request.name, name, value)
            for name, value in values_of(study.request)
            if name != "earlier" and not (name in ("pairs", "covariates", "between") and value == "none")
        ]
    return rows + [("version", name, number) for name, number in record.versions.items()]
