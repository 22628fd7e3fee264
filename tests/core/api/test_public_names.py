"""What ``import homolog`` gives: names, documentation, defaults, errors."""

import ast
import doctest
import inspect
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import homolog as hl
from homolog.api import correspond as api
from homolog.comparison.question import Question
from homolog.correspondence import optimize, repair
from homolog.geodesics import each_table, solve_tables
from homolog.settings import GroomSettings, OptimizeSettings, RunSettings
from homolog.statistics.comparison import Options

CORE = Path(hl.__file__).parents[1]


def test_importing_the_package_loads_nothing_but_the_standard_library():
    done = subprocess.run(
        [sys.executable, "-c", "import sys, homolog; print(*{one.split('.')[0] for one in sys.modules})"],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(CORE)},
    )
    tops = {part for part in done.stdout.split() if not part.startswith(("_", "homolog", "sitecustomize"))}
    assert tops <= sys.stdlib_module_names


def test_type_checkers_see_the_names_that_are_loaded_when_used():
    tree = ast.parse(Path(hl.__file__).read_text("utf-8"))
    (guarded,) = [item for item in tree.body if isinstance(item, ast.If) and isinstance(item.test, ast.Name)]
    seen = {alias.name: item.module for item in guarded.body for alias in item.names}
    for name, home in seen.items():
        assert getattr(hl, name) is getattr(import_module(home), name)
    assert sorted(seen) == hl.__all__


@pytest.mark.parametrize("name", hl.__all__)
def test_each_name_is_documented_with_what_it_takes_gives_and_refuses(name):
    value = getattr(hl, name)
    assert name in dir(hl)
    text = inspect.getdoc(value)
    assert len(text.splitlines()[0]) > 20
    if inspect.isfunction(value):
        assert all(f"{section}\n---" in text for section in ("Parameters", "Raises"))
        assert "Returns\n---" in text or inspect.signature(value).return_annotation is None
        assert all(
            f"\n{parameter} : " in text or f"\n**{parameter}" in text
            for parameter in inspect.signature(value).parameters
        )


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match=r"'homolog' .* 'nothing'"):
        _ = hl.nothing


@pytest.mark.parametrize("name", [item for item in hl.__all__ if ">>>" in (getattr(hl, item).__doc__ or "")])
def test_the_examples_of_the_docstrings_hold(name):
    value = getattr(hl, name)
    finder = doctest.DocTestFinder(recurse=False)
    runner = doctest.DocTestRunner()
    for test in finder.find(value, name, module=import_module(value.__module__)):
        runner.run(test)
    assert runner.tries
    assert not runner.failures


def test_settings_by_keyword_are_those_of_the_command_line():
    fields = {**GroomSettings.model_fields, **OptimizeSettings.model_fields}
    assert set(api.Settings.__annotations__) == set(fields) - {"particles", "seed", "segment"} | {
        "random_state"
    }
    assert len(fields) == len(GroomSettings.model_fields) + len(OptimizeSettings.model_fields)


def test_defaults_are_those_of_the_command_line_and_the_window():
    taken = {
        parameter.name: parameter.default
        for parameter in inspect.signature(hl.correspond).parameters.values()
    }
    made = api.run_settings({}, taken["n_particles"], taken["device"], taken["workers"])
    assert made.model_copy(update={"workers": None}) == RunSettings()


def test_every_value_of_a_setting_that_is_a_choice_is_taken():
    for name, annotation in inspect.get_annotations(api.Settings).items():
        for value in getattr(annotation, "__args__", ()):
            if isinstance(value, str):
                assert api.run_settings({name: value}, 64, "auto", 1)


def test_comparisons_have_the_defaults_of_the_analysis():
    taken = {
        parameter.name: parameter.default
        for parameter in inspect.signature(hl.compare_groups).parameters.values()
    }
    for name in ("modes", "permutations", "seed"):
        given = taken["random_state" if name == "seed" else name]
        assert given == getattr(Options(), name) == Question.model_fields[name].default
    assert taken["alignment"] == ("form", "shape")


@pytest.mark.parametrize(
    "function",
    [hl.correspond, hl.geodesic_distances, each_table, optimize, repair, solve_tables],
)
def test_the_device_is_chosen_by_itself_everywhere(function):
    assert inspect.signature(function).parameters["device"].default == RunSettings().device == "auto"


def test_errors_are_also_those_of_python():
    assert issubclass(hl.InputError, ValueError)
    assert issubclass(hl.NumericalError, ArithmeticError)
    assert not issubclass(hl.Cancelled, ValueError | ArithmeticError)
