import argparse

import pytest

from homolog.errors import InputError
from homolog.parameters import parameters
from homolog.settings import Alignment, GroomSettings, Method, OptimizeSettings, RunSettings
from homolog_app.cli.options import settings, with_options


@pytest.fixture
def parser():
    made = argparse.ArgumentParser()
    for model in (OptimizeSettings, GroomSettings, RunSettings):
        settings(model)(made)
    return made


def test_every_setting_is_an_option_with_its_help_bounds_and_unit(parser):
    text = " ".join(parser.format_help().split())
    for model in (OptimizeSettings, GroomSettings, RunSettings):
        for parameter in parameters(model):
            assert f"--{parameter.name.replace('_', '-')}" in text
            if parameter.name == "label":  # the option also takes a structure's name
                assert "--label LABEL" in text
                continue
            assert " ".join(parameter.help.split()) in text
            assert f"({parameter.bounds}" in text


def test_options_that_are_not_given_leave_the_settings_as_they_are(parser):
    settings = OptimizeSettings(particles=77, seed=5)
    assert with_options(settings, parser.parse_args([])) == settings
    changed = with_options(settings, parser.parse_args(["--method", "euclidean"]))
    assert changed == OptimizeSettings(particles=77, seed=5, method=Method.EUCLIDEAN)


def test_texts_become_values_of_the_settings_types(parser):
    grooming = ["--label", "2", "--spacing", "1.5", "--alignment", "axes", "--scaling"]
    arguments = parser.parse_args([*grooming, "--workers", "3", "--device", "cuda:1"])
    assert with_options(GroomSettings(), arguments) == GroomSettings(
        label=2, spacing=1.5, alignment=Alignment.AXES, scaling=True
    )
    assert with_options(RunSettings(), arguments) == RunSettings(workers=3, device="cuda:1")


def test_auto_takes_back_a_value_and_no_takes_back_a_switch(parser):
    arguments = parser.parse_args(["--label", "auto", "--no-scaling"])
    assert with_options(GroomSettings(label=3, scaling=True), arguments) == GroomSettings()


def test_each_bad_value_is_named_with_its_option(parser):
    arguments = parser.parse_args(["--particles", "2", "--method", "magic", "--seed", "one"])
    with pytest.raises(InputError) as caught:
        with_options(OptimizeSettings(), arguments)
    lines = str(caught.value).splitlines()
    assert [line.split(":")[0] for line in lines] == ["--method magic", "--particles 2", "--seed one"]
    assert "at least 4" in lines[1]
