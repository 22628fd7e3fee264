"""The result with the table of the cohort as it is now."""

from dataclasses import replace

from homolog.files.results import Result
from homolog_app.window.study import Study

__all__ = ["with_present_table"]


def with_present_table(result: Result, study: Study) -> Result:
    """Return a result with groups and columns as the study's table has them now, by subject."""
    present = {member.name: member.subject for member in study.members}
    groups, columns = [], []
    for name, group, values in zip(result.names, result.groups, result.columns, strict=True):
        known = present.get(name)
        groups.append(known.group if known is not None else group)
        columns.append(known.columns if known is not None else values)
    return replace(result, groups=tuple(groups), columns=tuple(columns))
