import csv

import numpy as np
import pytest
import SimpleITK

from homolog.beans.files import write_beans
from homolog.beans.generate import draw_beans, voxelize
from homolog.cohort import read_cohort
from homolog.errors import InputError


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("beans") / "cohort"
    beans = draw_beans(3, 12)
    return folder, beans, write_beans(folder, beans, 12)


def test_volumes_hold_the_bean_where_it_is_in_space(written):
    folder, beans, _ = written
    image = SimpleITK.ReadImage(str(folder / "bean_02.nrrd"))
    inside, index_to_world = voxelize(beans[1])
    np.testing.assert_array_equal(SimpleITK.GetArrayFromImage(image).T, inside)
    assert image.GetOrigin() == tuple(index_to_world[:3, 3])
    assert image.GetSpacing() == (1.0, 1.0, 1.0)


def test_the_table_of_the_truth_reads_back_exactly(written):
    folder, beans, _ = written
    with (folder / "truth.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["name"] for row in rows] == ["bean_01", "bean_02", "bean_03"]
    assert [(float(row["position_mm"]), float(row["width_mm"])) for row in rows] == [
        (bean.position, bean.width) for bean in beans
    ]
    assert {(row["geometry"], row["seed"]) for row in rows} == {("wide", "12")}


def test_the_folder_is_the_cohort_that_was_returned(written):
    folder, _, cohort = written
    assert [(subject.name, subject.path) for subject in read_cohort(folder).subjects] == [
        (subject.name, subject.path) for subject in cohort.subjects
    ]


def test_a_hundred_beans_sort_by_number(tmp_path, monkeypatch):
    monkeypatch.setattr("homolog.beans.files.voxelize", lambda bean: (np.zeros((2, 2, 2)), np.eye(4)))
    names = [subject.name for subject in write_beans(tmp_path, draw_beans(100, 0), 0).subjects]
    assert names == sorted(names)


def test_a_folder_that_can_not_be_made_is_an_input_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="can't be written"):
        write_beans(tmp_path / "file" / "cohort", draw_beans(2, 0), 0)
