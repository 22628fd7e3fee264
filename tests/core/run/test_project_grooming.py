"""One subject groomed again, among the others as they are."""

import shutil

from homolog.cohort import read_cohort
from homolog.io.project import ProjectFolder
from homolog.progress import no_tick
from homolog.run.project_grooming import groom_again, groom_project
from homolog.settings import GroomSettings, RunSettings


def test_a_subject_that_is_groomed_again_keeps_the_note_that_it_was_mirrored(ellipsoids, tmp_path):
    scans = tmp_path / "scans"
    scans.mkdir()
    for path, side in zip(sorted(ellipsoids.glob("*.nrrd"))[:3], "LRR", strict=True):
        shutil.copy(path, scans / f"{path.stem}_{side}.nrrd")
    cohort, project = read_cohort(scans, "{subject}_{side}.nrrd"), ProjectFolder(tmp_path / "project")
    settings = RunSettings(groom=GroomSettings(mesh_edge=2.0), workers=1)
    groomed, _ = groom_project(cohort, settings, project, no_tick)
    first = groomed[0]
    assert any("mirrored" in note for note in first.report.notes)
    others = {item.name: item for item in groomed}
    again = groom_again(cohort, first.name, others, settings, project, no_tick)
    assert again[first.name][0].report.notes == first.report.notes
    assert all(again[name][0] is item for name, item in others.items() if name != first.name)
