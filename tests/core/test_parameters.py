from typing import Annotated

import pytest
from pydantic import BaseModel, Field

from homolog.parameters import Parameter, parameters
from homolog.settings import Alignment, GroomSettings, Method, OptimizeSettings, RunSettings

ALL = [
    parameter for model in (RunSettings, GroomSettings, OptimizeSettings) for parameter in parameters(model)
]
LENGTHS = {"spacing", "mesh_edge"}


@pytest.mark.parametrize("first", ALL, ids=lambda item: item.name)
def test_every_setting_says_what_it_does(first):
    assert len(first.help) > 20
    assert first.help.endswith(".")


@pytest.mark.parametrize(
    "first", [item for item in ALL if item.kind in (int, float)], ids=lambda item: item.name
)
def test_every_number_has_bounds_and_lengths_have_a_unit(first):
    assert first.low is not None
    assert first.high is not None
    assert (first.unit == "mm") == (first.name in LENGTHS)


def test_names_are_unique_across_the_models_so_that_each_can_be_an_option():
    assert len({item.name for item in ALL}) == len(ALL)


def test_a_field_is_described_in_full():
    class Model(BaseModel):
        some_length: Annotated[
            float | None, Field(gt=0.5, le=2.0, description="How long.", json_schema_extra={"unit": "mm"})
        ] = None

    (first,) = parameters(Model)
    assert first == Parameter("some_length", float, True, None, 0.5, 2.0, True, "mm", "How long.")
    assert (first.label, first.bounds, first.choices) == ("some length", "above 0.5 to 2.0", ())


def test_closed_sets_list_their_choices():
    by_name = {item.name: item for item in ALL}
    assert by_name["method"].choices == tuple(Method)
    assert by_name["alignment"].choices == tuple(Alignment)
    assert by_name["method"].default is Method.GEODESIC_NORMALS
