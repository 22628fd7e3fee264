"""Write docs/api.md, the reference of the Python API, from the docstrings: ``python docs/make_api.py``."""

import inspect
import re
from collections.abc import Collection, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import homolog as hl
from homolog.cohort import Subject
from homolog.comparison.formula import Differences
from homolog.comparison.plan import Power, Stability
from homolog.parameters import parameters
from homolog.patient import Percentile, Region
from homolog.settings import GroomSettings, OptimizeSettings
from homolog.statistics.anova import AnovaRow, Difference
from homolog.statistics.assumptions import Dispersion
from homolog.statistics.comparison import Comparison
from homolog.statistics.discriminant import Discriminant
from homolog.statistics.effects import Effect
from homolog.statistics.mode_test import ModeTest
from homolog.statistics.pointwise_test import PointwiseTest
from homolog.statistics.relative_pose import Components, RelativePoses

PAGE = Path(__file__).with_name("api.md")

GROUPS: dict[str, list[Any]] = {
    "Shapes": [hl.read_cohort, hl.Cohort, Subject, hl.read_mesh, hl.write_mesh, hl.TriangleMesh],
    "Correspondence": [hl.correspond, hl.Correspondence, hl.Project],
    "Shape model": [hl.ShapeModel, RelativePoses, Components],
    "Group differences": [
        hl.compare_groups,
        hl.regress,
        hl.compare,
        hl.FormulaAnswer,
        AnovaRow,
        Differences,
        Difference,
        Comparison,
        ModeTest,
        PointwiseTest,
        Effect,
        Dispersion,
        Discriminant,
    ],
    "Questions to projects, and reports": [hl.analyze, hl.StudyAnswer, hl.report],
    "Planning": [hl.plan, hl.Plan, Power, Stability],
    "One patient": [
        hl.make_reference,
        hl.Reference,
        hl.compare_patient,
        hl.PatientComparison,
        Percentile,
        Region,
    ],
    "Geodesic distances": [hl.geodesic_distances],
    "Errors": [hl.InputError, hl.NumericalError, hl.Cancelled],
}

HEAD = """# Python API

<!-- Generated from the docstrings by `python docs/make_api.py`; edit those. -->

`import homolog as hl` provides the names below, which are loaded on first use. Lengths are millimetres,
coordinates LPS. M is the number of subjects, N of particles, K of modes. Returned arrays are read-only.
Classes without `hl.` are parts of others; `help(type(value))` explains their attributes,
`help(hl.ShapeModel.fit)` the parameters of a method, with examples and the errors that are raised.

Runnable examples: [a model of meshes in memory](examples/meshes_to_model.py),
[two groups](examples/two_groups.py), [geodesic distances](examples/geodesics.py),
[an existing project](examples/open_project.py), [one patient](examples/one_patient.py).
"""

RECURRING = {
    "callback": "`callback(fraction, message)`, about ten times per second. It may raise `Cancelled`, or any"
    " other error, to stop.",
    "random_state": "Random seed; the same seed gives the same result.",
    "permutations": "Number of permutations or randomizations of each test; p-values are at least"
    " 1 / (permutations + 1).",
    "complete_cases": "Whether subjects with missing values in the columns used are excluded and counted in"
    " `notes`, instead of refused.",
    "modes": "Number of modes that are tested beside the coordinates; by parallel analysis if not given.",
    "anyway": "Whether to use a model even if its verdict is *not usable*.",
    "names": "Names of the subjects, for messages; rows of pandas with texts as index are matched with them.",
    "voxel_size": "Voxel size of label arrays along their axes [mm]: a float or three.",
}

_SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}\n", re.MULTILINE)
_ENTRIES = ("Parameters", "Attributes", "Returns")
_ONLY_IN_HELP = ("Examples", "Raises", "References", "See Also")


def reference() -> str:
    """Return the page."""
    parts = [HEAD, "These parameters of functions are the same everywhere:\n"]
    parts += [f"- `{name}`: {text}" for name, text in RECURRING.items()]
    parts.append("")
    for title, members in GROUPS.items():
        parts.append(f"## {title}\n")
        for member in members:
            parts += _documented(member)
            if member is hl.correspond:
                parts += _settings()
    return re.sub(r"\n{3,}", "\n\n", "\n".join(parts)).rstrip() + "\n"


def _documented(member: Any) -> Iterator[str]:  # noqa: ANN401 - a class or a function
    name = member.__name__
    prefix = "hl." if name in hl.__all__ else ""
    if inspect.isfunction(member) and not prefix:
        prefix = f"{member.__module__}."
    signature = (
        _signature(member) if inspect.isfunction(member) or name in ("TriangleMesh", "Project") else ""
    )
    yield f"### `{prefix}{name}{signature}`\n"
    text = inspect.getdoc(member) or ""
    if not prefix:
        yield from _names_only(text)
        return
    yield from _markdown(text, RECURRING.keys() if inspect.isfunction(member) else ())
    if not inspect.isclass(member) or issubclass(member, Exception):
        return
    parts = [part for part in member.__mro__ if part is member or part.__module__.startswith("homolog.api.")]
    own = {
        attribute: value
        for part in parts
        for attribute, value in vars(part).items()
        if not attribute.startswith("_")
    }
    properties = {
        attribute: value for attribute, value in own.items() if isinstance(value, property | cached_property)
    }
    if properties:
        yield "**Properties**\n"
        yield from (
            f"- `{attribute}`: {_plain(inspect.getdoc(value) or '')}"
            for attribute, value in properties.items()
        )
        yield ""
    functions = {name: getattr(value, "__func__", value) for name, value in own.items()}
    methods = {name: value for name, value in functions.items() if inspect.isfunction(value)}
    if methods:
        yield "**Methods**\n"
        yield from (
            f"- `{attribute}{_signature(function)}`: {_plain(_summary(function))}"
            for attribute, function in methods.items()
        )
        yield ""


def _summary(function: Any) -> str:  # noqa: ANN401
    """Return the paragraphs before the first section."""
    return _SECTION.split(inspect.getdoc(function) or "")[0]


def _signature(function: Any) -> str:  # noqa: ANN401
    """Return names and defaults; types are in the docstring."""
    shown, starred = [], False
    for parameter in inspect.signature(function).parameters.values():
        if parameter.name in ("self", "cls"):
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and not starred:
            starred = True
            shown.append("*")
        prefix = "**" if parameter.kind is parameter.VAR_KEYWORD else ""
        shown.append(
            prefix
            + parameter.name
            + ("" if parameter.default is parameter.empty else f"={parameter.default!r}")
        )
    return f"({', '.join(shown)})"


def _names_only(text: str) -> Iterator[str]:
    """Return the first paragraph of a class's docstring, and the names of its attributes."""
    head, *sections = _SECTION.split(text)
    body = dict(zip(sections[::2], sections[1::2], strict=True))["Attributes"]
    names = [
        f"`{name}`"
        for entry in re.split(r"\n(?=\S)", body.strip("\n"))
        for name in entry.partition("\n")[0].partition(" : ")[0].split(", ")
    ]
    yield f"{_paragraphs(head)}\nAttributes: {', '.join(names)}.\n"


def _markdown(text: str, without: Collection[str]) -> Iterator[str]:
    """Return a numpydoc docstring as Markdown, but for some parameters."""
    head, *sections = _SECTION.split(text)
    yield _paragraphs(head)
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        if title in _ONLY_IN_HELP:
            continue
        if title == "Returns" and "\n" not in body.strip():
            yield f"\nReturns `{body.strip()}`."
        elif title in _ENTRIES:
            yield f"\n**{title}**\n"
            yield from _entries(body, without if title == "Parameters" else ())
        else:
            yield f"\n**{title}**\n\n{_paragraphs(body)}"
    yield ""


def _paragraphs(text: str) -> str:
    return "\n\n".join(_plain(block) for block in re.split(r"\n\s*\n", text.strip())) + "\n"


def _entries(body: str, without: Collection[str]) -> Iterator[str]:
    """Return entries, each a head at the left margin and an indented description, as a list."""
    for entry in re.split(r"\n(?=\S)", body.strip("\n")):
        head, _, text = entry.partition("\n")
        name, colon, kind = head.partition(" : ")
        if name in without:
            continue
        parts = [_plain(part) for part in (kind if colon else "", text) if part.strip()]
        yield ": ".join([f"- `{name}`", ". ".join(parts)]) if parts else f"- `{name}`"


def _plain(text: str) -> str:
    """Return text on one line, with single backticks for code."""
    return " ".join(text.replace("``", "`").split())


def _settings() -> Iterator[str]:
    yield "#### Settings\n"
    yield "What `**settings` takes; `homolog run --help` has the same options with their bounds.\n"
    yield "| name | default | |"
    yield "|---|---|---|"
    for model in (GroomSettings, OptimizeSettings):
        for setting in parameters(model):
            if setting.name in ("particles", "segment"):  # n_particles and label
                continue
            default = getattr(setting.default, "value", setting.default)
            unit = f" {setting.unit}" if setting.unit and default is not None else ""
            choices = f" ({', '.join(setting.choices)})" if setting.choices else ""
            name = {"seed": "random_state"}.get(setting.name, setting.name)
            text = setting.help.replace("Label value of", "Label value or name of")
            yield f"| `{name}` | `{default!r}`{unit} | {text}{choices} |"
    yield ""


if __name__ == "__main__":
    PAGE.write_text(reference(), encoding="utf-8")
