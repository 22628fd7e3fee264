"""``homolog reference`` and ``homolog patient`` from a finished run to two pages."""

import csv
import re
import signal
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from homolog_app.cli import CANCELLED, INPUT_ERROR, OK, main


@pytest.fixture(scope="module")
def reference(finished_run, small_references, tmp_path_factory):
    """Return a reference of four ellipsoids, which are too few for anything but a test."""
    path = tmp_path_factory.mktemp("reference") / "ref.npz"
    with small_references():
        assert main(["reference", str(finished_run.folder), "--out", str(path), "--progress", "none"]) == OK
    return path


@pytest.fixture(scope="module")
def report(reference, ellipsoids, tmp_path_factory):
    """Return the folder of one patient."""
    out = tmp_path_factory.mktemp("patient") / "out"
    arguments = ["patient", str(reference), str(ellipsoids / "a.nrrd"), "--out", str(out)]
    assert main([*arguments, "--progress", "none"]) == OK
    return out


def rows(path):
    with path.open() as stream:
        return list(csv.DictReader(stream))


def test_a_patient_gets_a_report_tables_and_surfaces(report):
    from homolog.io.meshes import read_mesh

    assert {path.name for path in report.iterdir()} == {
        "report.html",
        "report.pdf",
        "patients.csv",
        "regions.csv",
        "map.vtp",
        "patient.vtp",
        "patient_local.particles",
    }
    (row,) = rows(report / "patients.csv")
    assert row["name"] == "a"
    assert float(row["largest_z"]) < float(row["limit"])
    patient, expected = read_mesh(report / "patient.vtp"), read_mesh(report / "map.vtp")
    assert np.allclose(patient.vertices.mean(axis=0), expected.vertices.mean(axis=0), atol=1.0)


def test_a_comparison_that_is_terminated_leaves_nothing(reference, ellipsoids, tmp_path, monkeypatch):
    from homolog_app.report import patient

    def terminated(folder, *_):
        (folder / "half.csv").write_text("a,")
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(patient, "write_patients", terminated)
    arguments = ["patient", str(reference), str(ellipsoids / "a.nrrd"), "--out", str(tmp_path / "out")]
    assert main([*arguments, "--progress", "none"]) == CANCELLED
    assert not list(tmp_path.iterdir())


def test_particles_of_a_patient_lie_where_the_run_puts_them(report, reference, finished_run):
    from homolog.io.particles import read_particles
    from homolog.io.results import read_result
    from homolog.patient import Reference

    known = Reference.load(reference)
    assert known.placing is not None
    run = read_result(finished_run)
    there = run.local[run.names.index("a")]
    here = read_particles(report / "patient_local.particles")
    spacing = np.sqrt(known.surface.area / len(there))
    assert np.median(np.linalg.norm(here - there, axis=1)) < 0.3 * spacing


def test_every_page_says_research_use_and_the_report_its_day(report):
    page = (report / "report.html").read_text("utf-8")
    written = datetime.fromtimestamp((report / "report.html").stat().st_mtime, UTC)
    assert f"Report of {written.date().isoformat()}" in page
    assert page.count("For research use only") >= 2
    assert "project, 4 controls" in page
    pdf = (report / "report.pdf").read_bytes()
    assert len(re.findall(rb"/Type /Page\b", pdf)) in (2, 3)


def test_several_patients_get_one_table_and_bad_ones_a_line(reference, ellipsoids, tmp_path, capsys):
    import SimpleITK

    scans = tmp_path / "scans"
    scans.mkdir()
    (scans / "b.nrrd").write_bytes((ellipsoids / "b.nrrd").read_bytes())
    SimpleITK.WriteImage(SimpleITK.Image(8, 8, 8, SimpleITK.sitkUInt8), scans / "empty.nrrd")
    out = tmp_path / "out"
    arguments = ["patient", str(reference), str(scans), "--out", str(out), "--progress", "none"]
    assert main(arguments) == INPUT_ERROR
    good, bad = rows(out / "patients.csv")
    assert (good["name"], good["error"]) == ("b", "")
    assert "empty" in bad["error"]
    assert (out / "b" / "report.html").is_file()
    assert not (out / "empty").exists()
    assert "homolog: " in capsys.readouterr().err


def test_a_file_that_is_no_shape_leaves_nothing(reference, tmp_path, capsys):
    (tmp_path / "x.nrrd").write_text("no image")
    out = tmp_path / "out"
    assert main(["patient", str(reference), str(tmp_path / "x.nrrd"), "--out", str(out)]) == INPUT_ERROR
    assert not out.exists()
    assert "x.nrrd" in capsys.readouterr().err


def test_cautions_are_on_the_first_sheet_and_other_remarks_on_the_second(reference, ellipsoids):
    from homolog.cohort import Subject
    from homolog.patient import Reference, compare_patient
    from homolog_app.report.patient import patient_page
    from homolog_app.report.sheets import sheets_of

    controls = Reference.load(reference)
    plain = compare_patient(controls, Subject("a", ellipsoids / "a.nrrd"))
    comparison = replace(plain, cautions=("is cut",), remarks=("is repaired", "is cut"))
    sheets = sheets_of(patient_page(comparison, controls))
    first, *others = (" ".join(text.get_text() for text in sheet.figure.texts) for sheet in sheets)
    second = " ".join(others)
    assert ("is cut" in first, "is repaired" in first) == (True, False)
    assert ("is cut" in second, "is repaired" in second) == (False, True)


def test_a_control_that_is_unlike_the_others_is_cautioned_about(reference):
    from homolog.patient import Reference
    from homolog.patient.findings import reference_text

    usual = Reference.load(reference)
    distances = np.array([0.5, 0.6, 0.6, 2.7])
    cautions = [
        set(reference_text(replace(usual, outside=values))) for values in (distances[[0, 1, 2, 2]], distances)
    ]
    (caution,) = cautions[1] - cautions[0]
    assert "2.70 mm" in caution


def test_a_control_that_is_unlike_the_others_is_named_if_the_file_has_names(reference, ellipsoids, tmp_path):
    from homolog.cohort import Subject
    from homolog.patient import Reference, compare_patient

    usual = Reference.load(reference)
    outside = np.full(len(usual.outside), 0.5)
    outside[0] = 2.7
    names = tuple(f"control {index}" for index in range(len(outside)))
    anonymous = replace(usual, outside=outside, unlike=names[2:3])
    named = replace(anonymous, scores=np.zeros((len(names), usual.modes)), names=names)
    cautions = []
    for kept in (anonymous, named):
        kept.save(tmp_path / "ref.npz")
        comparison = compare_patient(
            Reference.load(tmp_path / "ref.npz"), Subject("a", ellipsoids / "a.nrrd")
        )
        cautions += [text for text in comparison.cautions if "2.70 mm" in text]
    assert [names[2] in text for text in cautions] == [False, True]


def test_a_few_controls_are_refused(finished_run, tmp_path, capsys):
    out = tmp_path / "ref.npz"
    assert main(["reference", str(finished_run.folder), "--out", str(out)]) == INPUT_ERROR
    assert "too few" in capsys.readouterr().err
    assert main(["reference", str(finished_run.folder), "--group", "X", "--out", str(out)]) == INPUT_ERROR
    assert "no subject has X" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize("suffix", ["pdf", "html"])
def test_the_report_alone_can_be_exported(reference, ellipsoids, tmp_path, suffix):
    out = tmp_path / f"a.{suffix}"
    arguments = ["export", "patient", str(reference), str(ellipsoids / "a.nrrd"), "--out", str(out)]
    assert main([*arguments, "--cut-off", "--progress", "none"]) == OK
    assert [path.name for path in tmp_path.iterdir()] == [out.name]
    if suffix == "pdf":
        assert len(re.findall(rb"/Type /Page\b", out.read_bytes())) in (2, 3)
    else:
        assert "research use" in (page := out.read_text("utf-8"))
        assert "no flat end" in page


def test_another_kind_of_report_is_refused(reference, ellipsoids, tmp_path, capsys):
    arguments = [
        "export",
        "patient",
        str(reference),
        str(ellipsoids / "a.nrrd"),
        "--out",
        str(tmp_path / "a.doc"),
    ]
    assert main(arguments) == INPUT_ERROR
    assert ".pdf or .html" in capsys.readouterr().err


def test_a_follow_up_writes_maps_of_change_and_says_when_no_error_is_known(
    reference, ellipsoids, tmp_path, capsys
):
    out = tmp_path / "out"
    files = [str(ellipsoids / f"{name}.nrrd") for name in ("a", "b")]
    arguments = ["patient", str(reference), *files, "--follow-up", "--out", str(out), "--progress", "none"]
    assert main(arguments) == OK
    (row,) = rows(out / "changes.csv")
    assert (row["time"], row["since"], row["repeats"], row["limit"]) == ("b", "a", "0", "")
    assert float(row["outward_mm"]) > float(row["inward_mm"])
    page = (out / "follow_up.html").read_text("utf-8")
    assert page.count("For research use only") >= 2
    assert "No measurement error" in page
    assert "Times: a; b. Reference: project, 4 controls. Report of 20" in page
    assert "<td>no limit</td>" in page
    assert {"a", "b", "patients.csv", "changes.vtp"} <= {path.name for path in out.iterdir()}
    assert "without a limit" in capsys.readouterr().out


def test_a_follow_up_of_one_file_and_repeats_without_one_are_refused(reference, ellipsoids, tmp_path):
    arguments = ["patient", str(reference), str(ellipsoids / "a.nrrd"), "--out", str(tmp_path / "out")]
    assert main([*arguments, "--follow-up"]) == INPUT_ERROR
    assert main([*arguments, "--repeat", str(ellipsoids / "b.nrrd")]) == INPUT_ERROR
    assert not (tmp_path / "out").exists()


def test_several_groups_have_a_line_each_and_no_page_calls_it_a_diagnosis(
    reference, ellipsoids, tmp_path, capsys
):
    out = tmp_path / "out"
    arguments = ["patient", str(reference), str(ellipsoids / "a.nrrd"), "--against", str(reference)]
    assert main([*arguments, "--out", str(out), "--progress", "none"]) == OK
    first, second = rows(out / "groups.csv")
    assert first == second
    assert 0.05 < float(first["p"]) <= 1.0
    assert "Not a diagnosis" in (out / "report.html").read_text("utf-8")
    assert "95 % of the group" in capsys.readouterr().out
