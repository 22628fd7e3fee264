from typing import Annotated

import pytest
from pydantic import BaseModel, Field, ValidationError

from homolog.parameters import Parameter, fault_text, parameters
from homolog.settings import Alignment, GroomSettings, Method, OptimizeSettings, RunSettings

ALL = [
    parameter for model in (RunSettings, GroomSettings, OptimizeSettings) for parameter in parameters(model)
]
LENGTHS = {"spacing", "mesh_edge"}


@pytest.mark.parametrize("parameter", ALL, ids=lambda item: item.name)
def test_every_setting_says_what_it_does(parameter):
    assert len(parameter.help) > 20
    assert parameter.help.endswith(".")


@pytest.mark.parametrize(
    "parameter", [item for item in ALL if item.kind in (int, float)], ids=lambda item: item.name
)
def test_every_number_has_bounds_and_lengths_have_a_unit(parameter):
    assert parameter.low is not None
    assert parameter.high is not None
    assert (parameter.unit == "mm") == (parameter.name in LENGTHS)


def test_names_are_unique_across_the_models_so_that_each_can_be_an_option():
    assert len({item.name for item in ALL}) == len(ALL)


def test_a_field_is_described_in_full():
    class Model(BaseModel):
        some_length: Annotated[
            float | None, Field(gt=0.5, le=2.0, description="How long.", json_schema_extra={"unit": "mm"})
        ] = None

    (parameter,) = parameters(Model)
    assert parameter == Parameter("some_length", float, True, None, 0.5, 2.0, True, "mm", "How long.")
    assert (parameter.label, parameter.bounds, parameter.choices) == (
        "some length",
        "above 0.5, at most 2",
        (),
    )


def test_closed_sets_list_their_choices():
    by_name = {item.name: item for item in ALL}
    assert by_name["method"].choices == tuple(Method)
    assert by_name["alignment"].choices == tuple(Alignment)
    assert by_name["method"].default is Method.GEODESIC_NORMALS


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"device": "gpu"}, "must be auto, cpu, cuda"),
        ({"cluster": "here"}, "must be local, slurm, or the address"),
        ({"workers": 0}, "must be at least 1"),
        ({"workers": "two"}, "must be a whole number"),
        ({"optimize": {"method": "best"}}, "must be 'geodesic-normals'"),
        ({"optimize": {"tolerance": 0.0}}, "must be more than 0"),
    ],
)
def test_a_value_that_is_refused_comes_with_what_it_must_be(values, text):
    with pytest.raises(ValidationError) as raised:
        RunSettings.model_validate(values)
    (fault,) = raised.value.errors()
    assert fault_text(fault).startswith(text)
