import csv
import threading

import numpy as np
import pytest

from homolog.cohort import Cohort, Subject
from homolog.errors import InputError, NumericalError, WorkerDiedError
from homolog.grooming import Problem, groom_cohort
from homolog.io.arrays import read_arrays
from homolog.io.meshes import read_mesh
from homolog.io.results import read_modes, read_result, read_surfaces
from homolog.run import FinishReason, Phase
from homolog.settings import Method

WITHOUT_CORE_SET = [phase for phase in Phase if phase is not Phase.FITTING]


def contents(project):
    """Return every file of a result by name, as bytes; without the record, which tells the time of day."""
    return {
        str(path.relative_to(project.folder)): path.read_bytes()
        for path in sorted(project.folder.rglob("*"))
        if (path.is_file() and path.parent.name in ("particles", "model")) or path.name == "energies.csv"
    }


def cancelling(run, phase):
    """Return an observer that cancels the run when it gets to a phase."""

    def observer(status):
        if status.phase is phase:
            run.cancel()

    return observer


def test_a_run_tells_its_phases_in_order_and_ends_completed(start, groomed):
    run, heard = start(), []
    assert run.execute(heard.append) is FinishReason.COMPLETED
    assert list(dict.fromkeys(item.phase for item in heard)) == WITHOUT_CORE_SET
    fractions = [item.fraction for item in heard]
    assert fractions == sorted(fractions)
    assert [item.reason for item in heard if item.reason] == [FinishReason.COMPLETED]
    assert (run.status.reason, run.status.fraction) == (FinishReason.COMPLETED, 1.0)
    assert run.frame.world.shape == (4, 48, 3)


def test_a_method_without_geodesics_skips_their_phase(start, settings, groomed):
    quick = settings.optimize.model_copy(update={"method": Method.EUCLIDEAN})
    heard = []
    start(settings=settings.model_copy(update={"optimize": quick})).execute(heard.append)
    assert Phase.GEODESICS not in {item.phase for item in heard}


def test_particles_lie_on_the_surfaces_and_the_frames_agree(finished):
    result = read_result(finished)
    assert result.names == ("a", "b", "c", "d")
    assert result.world.shape == result.local.shape == (4, 48, 3)
    moved = np.einsum("mij,mnj->mni", result.alignments[:, :3, :3], result.local)
    assert np.allclose(moved + result.alignments[:, None, :3, 3], result.world, atol=1e-9)
    for surface, points in zip(read_surfaces(finished), result.world, strict=True):
        gaps = np.linalg.norm(points[:, None] - surface.vertices, axis=2).min(axis=1)
        assert gaps.max() < surface.mean_edge


def test_scores_and_modes_on_disk_give_back_the_particles(finished):
    result = read_result(finished)
    with (finished.model / "scores.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    with (finished.model / "eigenvectors.csv").open() as stream:
        vectors = np.array([[float(value) for value in row[2:]] for row in list(csv.reader(stream))[1:]])
    scores = np.array([[float(row[f"mode_{k + 1}_rms_mm"]) for k in range(vectors.shape[1])] for row in rows])
    rebuilt = result.world.mean(axis=0) + (scores @ vectors.T).reshape(4, -1, 3)
    assert [row["name"] for row in rows] == list(result.names)
    assert np.allclose(rebuilt, result.world, atol=1e-9)
    assert np.allclose(np.square(vectors).sum(axis=0), len(vectors) / 3)  # 1 mm, root mean square
    with (finished.model / "eigenvalues.csv").open() as stream:
        deviations = [float(row["standard_deviation_rms_mm"]) for row in csv.DictReader(stream)]
    assert np.allclose(scores.std(axis=0, ddof=1), deviations)
    moves = read_modes(finished, result.mean_surface)
    assert moves.shape[1:] == result.mean_surface.vertices.shape
    assert 0.2 < np.linalg.norm(moves[0], axis=1).max() < 3.0


def test_the_mean_surface_is_there_for_other_programs_too(finished):
    first, other = (read_mesh(finished.model / f"mean.{kind}") for kind in ("vtp", "ply"))
    np.testing.assert_array_equal(first.faces, other.faces)
    np.testing.assert_allclose(first.vertices, other.vertices, rtol=1e-5, atol=1e-4)


def test_the_same_seed_gives_the_same_bits_with_any_memory(start, finished, groomed, settings):
    start(settings=settings.model_copy(update={"memory": 0.1})).execute()
    assert contents(groomed) == contents(finished)
    assert groomed.read().result.fingerprint == finished.read().result.fingerprint


def test_a_project_runs_again_from_its_cached_surfaces(start, finished, again, monkeypatch):
    monkeypatch.setattr("homolog.grooming.cohort.groom", None)
    start().execute()
    assert contents(again) == contents(finished)


def test_the_record_says_how_the_result_came_about(finished, settings):
    record = finished.read()
    assert not record.unfinished
    assert record.result.settings == settings
    assert record.result.metric == "geodesic"
    assert record.result.folded_faces == 0
    assert {"reading", "grooming", "optimizing", "modeling"} <= set(record.result.seconds)
    assert [subject.path for subject in record.subjects] == [f"../scans/{name}.nrrd" for name in "abcd"]
    assert not finished.checkpoint.exists()


def test_a_run_broken_off_in_the_optimization_ends_as_if_it_had_not_been(start, finished, groomed):
    run = start()
    assert run.execute(cancelling(run, Phase.OPTIMIZING)) is FinishReason.CANCELLED
    assert groomed.read().unfinished
    assert groomed.checkpoint.is_file()
    assert run.status.fraction == read_arrays(groomed.checkpoint)["fraction"] > 0.3
    heard = []
    assert start(resume=True).execute(heard.append) is FinishReason.COMPLETED
    assert contents(groomed) == contents(finished)


@pytest.mark.parametrize("phase", WITHOUT_CORE_SET)
def test_a_run_can_be_cancelled_in_every_phase_and_the_last_result_stays(start, finished, again, phase):
    run, heard = start(), []

    def observer(status):
        heard.append(status)
        cancelling(run, phase)(status)

    assert run.execute(observer) is FinishReason.CANCELLED
    assert (heard[-1].reason, heard[-1].phase) == (FinishReason.CANCELLED, phase)
    assert contents(again) == contents(finished)
    assert read_result(again).names == ("a", "b", "c", "d")


def test_the_particles_of_a_cancelled_run_can_be_kept_and_the_run_resumed(start, finished, groomed):
    run = start()
    run.execute(cancelling(run, Phase.OPTIMIZING))
    assert run.can_be_kept
    assert run.keep()
    kept = read_result(groomed)
    assert np.array_equal(kept.world, run.frame.world)
    for surface, points in zip(read_surfaces(groomed), kept.world, strict=True):
        assert (
            np.linalg.norm(points[:, None] - surface.vertices, axis=2).min(axis=1).max() < surface.mean_edge
        )
    record = groomed.read()
    assert (record.unfinished, record.result.ended) == (True, "cancelled")
    start(resume=True).execute()
    assert contents(groomed) == contents(finished)
    assert groomed.read().result.ended != "cancelled"


def test_a_run_cancelled_before_there_are_particles_has_nothing_to_keep(start, groomed):
    run = start()
    run.execute(cancelling(run, Phase.ALIGNING))
    assert not run.can_be_kept
    assert not run.keep()
    assert groomed.read().result is None


def test_a_run_can_be_paused_from_another_thread(start, groomed):
    run = start()
    paused = threading.Event()

    def observer(status):
        if status.phase is Phase.OPTIMIZING and not paused.is_set():
            run.set_paused(True)
        if status.paused:
            paused.set()

    worker = threading.Thread(target=run.execute, args=(observer,))
    worker.start()
    assert paused.wait(60)
    frame = run.frame
    assert worker.is_alive()
    assert run.status.paused
    assert run.frame is frame
    run.set_paused(False)
    worker.join(60)
    assert run.status.reason is FinishReason.COMPLETED


def test_other_settings_cannot_resume_a_run(start, groomed, settings):
    run = start()
    run.execute(cancelling(run, Phase.OPTIMIZING))
    other = settings.optimize.model_copy(update={"seed": 1})
    with pytest.raises(InputError, match="start a new run"):
        start(settings=settings.model_copy(update={"optimize": other}), resume=True).execute()


def test_every_bad_file_is_named_before_anything_is_written(start, project):
    scans = project.folder.parent / "scans"
    (scans / "e.nrrd").write_bytes((scans / "a.nrrd").read_bytes()[:-300])
    (scans / "f.nrrd").write_text("no image")
    heard = []
    with pytest.raises(InputError) as caught:
        start().execute(heard.append)
    lines = str(caught.value).splitlines()
    assert ["e.nrrd" in lines[0], "f.nrrd" in lines[1], len(lines)] == [True, True, 2]
    assert heard[-1].reason is FinishReason.FAILED
    assert not project.folder.exists()


def test_subjects_refused_for_one_reason_share_a_line(start, project):
    scans = project.folder.parent / "scans"
    empty = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 8 8 8\nencoding: raw\n\n" + bytes(512)
    for file in [*scans.glob("*.nrrd")]:
        file.write_bytes(empty)
    with pytest.raises(InputError) as caught:
        start().execute()
    message = str(caught.value)
    assert message.count("\n") == 0
    assert "a.nrrd" in message
    assert "3 more" in message


def test_bad_files_can_be_left_out(start, groomed):
    (groomed.folder.parent / "scans" / "e.nrrd").write_text("no image")
    run = start(skip_bad=True)
    assert run.execute() is FinishReason.COMPLETED
    assert read_result(groomed).names == ("a", "b", "c", "d")
    assert ["e.nrrd" in note for note in run.notes] == [True]


def test_subjects_that_a_dead_worker_had_in_hand_are_groomed_again(start, groomed, monkeypatch):
    deaths = []

    def groom_after(count):
        def die_first(*cohort, **how):
            if len(deaths) < count:
                deaths.append(1)
                raise WorkerDiedError("a grooming process died")
            return groom_cohort(*cohort, **how)

        return die_first

    monkeypatch.setattr("homolog.run.run.groom_cohort", groom_after(3))
    with pytest.raises(WorkerDiedError):
        start().execute()
    monkeypatch.setattr("homolog.run.run.groom_cohort", groom_after(5))
    run = start()

    def cancel(status):
        if status.phase is Phase.ALIGNING:
            run.cancel()

    assert run.execute(cancel) is FinishReason.CANCELLED
    assert len(deaths) == 5


def test_what_grooming_cannot_use_is_left_out_too(start, groomed, monkeypatch):
    def groom_all_but_b(cohort, *_, left_out, **how):
        left_out.append(Problem("b", "b: is too small for a surface"))
        return groom_cohort(cohort.without({"b"}), *_, **how)

    monkeypatch.setattr("homolog.run.run.groom_cohort", groom_all_but_b)
    run = start(skip_bad=True)
    assert run.execute() is FinishReason.COMPLETED
    assert read_result(groomed).names == ("a", "c", "d")
    assert [subject.name for subject in groomed.read().subjects] == ["a", "c", "d"]
    assert run.notes == ("b: is too small for a surface",)
    assert groomed.read().result.excluded == list(run.notes)


def test_why_files_were_left_out_survives_an_interruption_and_a_further_run(start, groomed, settings):
    (groomed.folder.parent / "scans" / "e.nrrd").write_text("no image")
    first = start(skip_bad=True)
    assert first.execute(cancelling(first, Phase.OPTIMIZING)) is FinishReason.CANCELLED
    assert start(groomed.cohort(), resume=True).execute() is FinishReason.COMPLETED
    assert groomed.read().result.excluded == list(first.notes) != []
    more = settings.optimize.model_copy(update={"particles": 64})
    start(groomed.cohort(), settings.model_copy(update={"optimize": more})).execute()
    assert groomed.read().result.excluded == list(first.notes)


def test_a_file_that_is_used_again_is_not_called_excluded(start, groomed):
    bad = groomed.folder.parent / "scans" / "e.nrrd"
    bad.write_text("no image")
    first = start(skip_bad=True)
    assert first.execute(cancelling(first, Phase.OPTIMIZING)) is FinishReason.CANCELLED
    bad.write_bytes(bad.with_name("d.nrrd").read_bytes())
    start().execute()
    assert groomed.read().result.excluded == []
    assert "e" in read_result(groomed).names


def test_a_cohort_of_one_is_refused(start, project):
    scans = project.folder.parent / "scans"
    cohort = Cohort((Subject("a", scans / "a.nrrd"),), scans)
    with pytest.raises(InputError, match="only one usable subject"):
        start(cohort).execute()
    assert not project.folder.exists()


def test_a_project_that_cannot_be_written_to_is_named(start, project):
    project.folder.write_text("a file in its place")
    with pytest.raises(InputError, match="can't be written"):
        start().execute()


def test_a_failed_computation_is_told_first_and_then_raised(start, monkeypatch, groomed):
    def fail(*_, **__):
        raise NumericalError("b: lost a particle")

    monkeypatch.setattr("homolog.run.steps.optimize", fail)
    heard = []
    with pytest.raises(NumericalError, match="lost a particle"):
        start().execute(heard.append)
    assert (heard[-1].reason, heard[-1].message) == (FinishReason.FAILED, "b: lost a particle")
    with groomed.locked():
        assert groomed.read().unfinished
