"""A patient against a reference: what is found where, what is refused, and what the file holds."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.geometry import rotation_of, transform_points
from homolog.patient import Reference, checks, compare_groomed, typicality
from homolog.patient.build import scores_of_points
from homolog.patient.checks import check_fit
from homolog.patient.own_surface import own_surface
from homolog.patient.surface_model import SurfaceModel
from homolog.surfaces.mesh import TriangleMesh

from .conftest import build, groomed, moved, shape

AGE = {"age": "60"}


def patient(template, *, bump=0.0, at=(0.0, 0.0, 1.0), width=6.0, scale=1.0, seed=11):
    """Return a new subject, groomed; a bump [mm] at a direction has a width [mm]."""
    directions, faces = template
    random = np.random.default_rng(seed)
    points = shape(directions, random)
    centre = points[np.argmax(directions @ np.array(at))]
    gaussian = np.exp(-0.5 * np.square(points - centre).sum(axis=1) / width**2)
    points = points + bump * gaussian[:, None] * TriangleMesh(points, faces).vertex_normals
    return groomed("p", TriangleMesh(scale * moved(points, random), faces))


@pytest.fixture(scope="module")
def bumped(reference, template):
    return compare_groomed(reference, patient(template, bump=5.0), AGE)


def test_a_bump_is_found_where_it_is_and_nothing_else_is(bumped, reference):
    (region,) = bumped.regions
    assert 3.0 < region.peak < 5.5
    assert region.mean > 0.0
    top = bumped.mean.vertices[:, 2].max()
    assert bumped.expected.vertices[region.centre, 2] > 0.8 * top
    assert bumped.local.p == pytest.approx(1 / 25)
    assert set(bumped.nearest_particles(region, reference)) < set(range(100))


def test_the_fit_does_not_bend_towards_the_bump(bumped, reference, template):
    plain = compare_groomed(reference, patient(template), AGE)
    gap = np.linalg.norm(bumped.expected.vertices - plain.expected.vertices, axis=1)
    assert gap.max() < 1.0
    assert not plain.regions


def test_particles_lie_on_the_patient(bumped):
    from homolog.surfaces.closest import distances_to

    assert distances_to(bumped.mesh, bumped.particles).max() < 0.5


def test_placement_takes_the_file_to_the_reference(bumped):
    there = transform_points(bumped.placement, bumped.mesh.vertices)
    assert there.mean(axis=0) == pytest.approx(bumped.mean.vertices.mean(axis=0), abs=2.0)


def test_a_dent_is_inward(reference, template):
    comparison = compare_groomed(reference, patient(template, bump=-4.0), AGE)
    assert comparison.regions[0].peak < -2.0


def test_a_large_patient_is_large_and_no_more(reference, template):
    comparison = compare_groomed(reference, patient(template, scale=1.25), AGE)
    assert comparison.size.percent == 100.0
    assert comparison.size.p == pytest.approx(2 / 25)


def test_age_is_adjusted_for(reference, template):
    subject = patient(template)
    young, old = (compare_groomed(reference, subject, {"age": age}) for age in ("45", "75"))
    end = np.argmax(young.mean.vertices[:, 0])
    assert old.mean.vertices[end, 0] - young.mean.vertices[end, 0] == pytest.approx(1.3, abs=0.5)


def test_a_saved_reference_gives_the_same(reference, template, tmp_path):
    reference.save(tmp_path / "ref.npz")
    again = Reference.load(tmp_path / "ref.npz")
    assert again.fingerprint == reference.fingerprint
    subject = patient(template, bump=3.0)
    first, second = (compare_groomed(item, subject, AGE) for item in (reference, again))
    assert np.array_equal(first.z, second.z)


def test_a_reference_names_no_control(reference, tmp_path):
    reference.save(tmp_path / "ref.npz")
    with np.load(tmp_path / "ref.npz") as stored:
        assert "c0" not in str(stored["record"])
        shapes = {name: stored[name].shape for name in stored.files}
    assert not any(24 in item[:1] and len(item) > 1 for item in shapes.values())


@pytest.mark.parametrize(
    ("scale", "message"), [(0.1, "cm: export it in mm"), (0.001, "to be m: export"), (4.0, "check its unit")]
)
def test_another_unit_is_recognised(reference, template, scale, message):
    subject = patient(template, scale=scale)
    with pytest.raises(InputError, match=message):
        compare_groomed(reference, subject, AGE)


@pytest.mark.parametrize("axes", [[6.0, 6.0, 48.0], [9.0, 9.0, 9.0], [40.0, 40.0, 4.0]])
def test_another_structure_is_refused(reference, template, axes):
    directions, faces = template
    rod = groomed("rod", TriangleMesh(directions * axes, faces))
    with pytest.raises(InputError, match=r"rod: .* not look like"):
        compare_groomed(reference, rod, AGE)


def test_a_structure_that_fits_badly_is_not_called_mirrored(reference, template, bumped, monkeypatch):
    far = replace(bumped.measures, gap=0.5)
    columns = reference.coding.columns(bumped.covariates)[0]
    monkeypatch.setattr(checks, "gap_of_image", lambda *_: 0.25)
    with pytest.raises(InputError, match="does not look like"):
        check_fit("p", reference, bumped.mesh, bumped.fit, far, columns)


def test_a_missing_covariate_is_named(reference, template):
    with pytest.raises(InputError, match="adjusted for age"):
        compare_groomed(reference, patient(template), {})


def test_an_age_beyond_the_controls_is_remarked(reference, template):
    comparison = compare_groomed(reference, patient(template), {"age": "95"})
    assert any("extrapolated" in remark for remark in comparison.cautions)


def test_a_side_that_the_reference_has_no_use_for_is_remarked(reference, template):
    comparison = compare_groomed(reference, patient(template), {"age": "60"}, side="left")
    assert any("left" in remark for remark in comparison.remarks)


@pytest.mark.parametrize("damage", [{"limit": None}, {"model_mean": np.zeros((3, 3))}])
def test_a_damaged_reference_is_refused(reference, tmp_path, damage):
    import json

    path = tmp_path / "ref.npz"
    reference.save(path)
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    record = json.loads(str(arrays["record"]))
    for name, value in damage.items():
        if name in record:
            del record[name]
        else:
            arrays[name] = value
    arrays["record"] = np.array(json.dumps(record))
    np.savez(path, **arrays)
    with pytest.raises(InputError, match="damaged"):
        Reference.load(path)


def test_a_reference_of_an_older_version_is_read_or_said_to_be_made_again(reference, template, tmp_path):
    import json

    path = tmp_path / "old.npz"
    older = replace(reference, provenance=replace(reference.provenance, versions={"homolog": "0.1.9"}))
    replace(older, mirrored=None, placing=None).save(path)
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    record = json.loads(str(arrays["record"]))
    for name in ("names", "placing", "change_between"):  # not yet in files of older versions
        del record[name]
    arrays["record"] = np.array(json.dumps(record))
    np.savez(path, **arrays)
    comparison = compare_groomed(Reference.load(path), patient(template), AGE)
    assert comparison.measures == compare_groomed(reference, patient(template), AGE).measures
    assert any("0.1.9" in remark for remark in comparison.remarks)
    del arrays["local_mean"]
    np.savez(path, **arrays)
    with pytest.raises(InputError, match=r"0\.1\.9.*local_mean.*make it again"):
        Reference.load(path)


def test_another_archive_is_no_reference(tmp_path):
    np.savez(tmp_path / "x.npz", mean=np.zeros(3))
    with pytest.raises(InputError, match="not a reference"):
        Reference.load(tmp_path / "x.npz")


def notched(template, side):
    """Return directions with a notch that only one of the two mirror images has."""
    directions, _ = template
    depth = np.zeros(len(directions))
    for place, much in (((side, 1.0, 0.3), 9.0), ((0.0, -1.0, 0.9), 7.0), ((1.0 * side, -0.2, -1.0), 8.0)):
        way = np.array(place) / np.linalg.norm(place)
        depth += much * np.exp(-0.5 * np.square(np.arccos(np.clip(directions @ way, -1, 1)) / 0.35))
    return depth


def test_the_other_side_is_recognised_and_mirrored_if_it_is_said(template, provenance):
    directions, faces = template
    random = np.random.default_rng(5)

    def subject(side):
        points = shape(directions, random) - notched(template, side)[:, None] * directions
        return points

    sided = build(template, replace(provenance, side="right"), 14, subject)
    other = groomed("p", TriangleMesh(moved(subject(-1.0), random), faces))
    with pytest.raises(InputError, match=r"better mirrored .* give its side \(left\)"):
        compare_groomed(sided, other)
    comparison = compare_groomed(sided, other, side="left")
    by_table = compare_groomed(sided, other, {"side": "L"})
    assert np.array_equal(by_table.z, comparison.z)
    with pytest.raises(InputError, match="side up: must be left or right"):
        compare_groomed(sided, other, {"side": "up"})
    assert comparison.outside.value < 2.0 * sided.outside[-1]
    assert np.linalg.det(comparison.placement[:3, :3]) < 0.0
    forced = compare_groomed(sided, other, force=True)
    assert any("mirrored" in remark for remark in forced.remarks)


@pytest.mark.parametrize(
    ("least", "most", "limited"),
    [(1.3, 1.9, True), (0.9, 1.2, False), (1.15, 1.8, True), (1.0, 1.8, False), (0.5, 0.7, False)],
)
def test_a_side_is_checked_only_where_the_shape_tells_it_and_no_control_is_flagged(
    reference, least, most, limited
):
    ratios = np.exp(np.linspace(np.log(least), np.log(most), 24))
    limit = replace(reference, mirrored=ratios).side_limit
    assert (limit is not None) is limited
    assert limit is None or limit <= min(1.0, ratios.min())


def test_a_sided_shape_that_fits_no_worse_than_controls_is_recognised_by_its_mirror_image(
    template, provenance
):
    directions, faces = template
    random = np.random.default_rng(5)

    def subject(side):  # notches of much smaller depth
        points = shape(directions, random)
        return points - 0.25 * notched(template, side)[:, None] * directions

    sided = build(template, provenance, 14, subject)
    assert sided.side_limit is not None
    other = groomed("p", TriangleMesh(moved(subject(-1.0), random), faces))
    with pytest.raises(InputError, match=r"better mirrored .*file is mirrored; correct the file"):
        compare_groomed(sided, other)
    assert compare_groomed(sided, groomed("q", TriangleMesh(moved(subject(1.0), random), faces))) is not None
    neither = groomed("r", TriangleMesh(moved(shape(directions, random), random), faces))
    wide = replace(sided, mirrored=np.exp(np.linspace(0.3, 1.3, 14)))
    assert any("mirrored" in remark for remark in compare_groomed(wide, neither).remarks)


def test_what_the_image_cuts_off_is_named_and_too_much_is_refused(reference, template):
    _, faces = template
    whole = patient(template)

    def cut(share):
        points = whole.mesh.vertices - whole.mesh.vertices.mean(axis=0)
        points = cut_at(points, np.quantile(points[:, 0], 1.0 - share))
        return groomed("p", TriangleMesh(points, faces), borders=((1.0, 0.0, 0.0),))

    comparison = compare_groomed(reference, cut(0.12), AGE)
    (share,) = (
        int(remark.split(" %")[0].split()[-1]) for remark in comparison.remarks if "cut off" in remark
    )
    assert 9 <= share <= 15
    assert not comparison.regions
    assert np.all(comparison.expected.vertices[comparison.missing, 0] > 15.0)
    assert abs(comparison.measures.size / compare_groomed(reference, whole, AGE).measures.size - 1.0) < 0.02
    with pytest.raises(InputError, match="is cut off"):
        compare_groomed(reference, cut(0.45), AGE)
    assert not any("cut off" in remark for remark in compare_groomed(reference, whole, AGE).remarks)


def cut_at(points, place):
    """Return points (n, 3) that lie beyond a plane across the first axis pressed onto it."""
    cut = points - points.mean(axis=0)
    cut[:, 0] = np.minimum(cut[:, 0], place + 1e-4 * cut[:, 0])
    return cut


def test_a_flat_end_inside_the_image_is_remarked_and_left_out_if_it_is_said_to_be_cut_off(
    reference, template
):
    _, faces = template
    whole = patient(template)
    cut = groomed("p", TriangleMesh(cut_at(whole.mesh.vertices, 20.0), faces))
    as_it_is = compare_groomed(reference, cut, AGE)
    assert as_it_is.regions[0].peak < -5.0
    assert any("flat end (left)" in remark for remark in as_it_is.remarks)
    left_out = compare_groomed(reference, cut, AGE, cut_off=True)
    assert not left_out.regions
    assert np.all(left_out.expected.vertices[left_out.missing, 0] > 12.0)
    assert any(remark.startswith("cut off") for remark in left_out.remarks)
    assert not any("flat end" in remark for remark in left_out.remarks)
    far = groomed("p", TriangleMesh(cut_at(whole.mesh.vertices, 3.0), faces))
    with pytest.raises(InputError, match="is cut off: "):
        compare_groomed(reference, far, AGE, cut_off=True)


def test_a_dent_is_no_flat_end(reference, template):
    dent = patient(template, bump=-4.0)
    for cut_off in (False, True):
        comparison = compare_groomed(reference, dent, AGE, cut_off=cut_off)
        assert comparison.regions[0].peak < -2.0
        assert not comparison.missing.any()
    assert any("no flat end" in remark for remark in comparison.remarks)


def test_touching_the_border_of_the_image_alone_is_no_cut(reference, template):
    _, faces = template
    points = patient(template).mesh.vertices
    rough = points * (1.0 + 0.06 * np.sin(0.6 * points[:, [1]]) * np.sin(0.6 * points[:, [2]]))
    at_border = groomed("p", TriangleMesh(rough, faces), borders=((1.0, 0.0, 0.0),))
    comparison = compare_groomed(reference, at_border, AGE)
    assert comparison.measures.gap > reference.gap[-1]
    assert not comparison.missing.any()
    assert any("check that it shows the whole structure" in remark for remark in comparison.remarks)


def test_a_patient_whose_image_ends_where_those_of_controls_end_is_not_cut_off(reference, template):
    _, faces = template
    end = groomed(
        "p", TriangleMesh(cut_at(patient(template).mesh.vertices, 18.0), faces), borders=((1.0, 0.0, 0.0),)
    )
    alone = compare_groomed(reference, end, AGE)
    assert any("cut off by the border" in remark for remark in alone.remarks)
    touching = np.tile(rotation_of(alone.placement)[:, 0], (2, 1))
    alike = compare_groomed(replace(reference, borders=touching), end, AGE)
    assert not any("border" in remark for remark in alike.remarks)
    assert alike.regions[0].peak < 0.0
    one = compare_groomed(replace(reference, borders=touching[:1]), end, AGE)  # 1 of 24 is not usual
    assert one.missing.any()


def test_the_nearest_controls_are_told_only_by_a_reference_that_keeps_scores(reference, tmp_path):
    assert reference.nearest(np.zeros(9)) == []
    scores = np.random.default_rng(4).normal(size=(24, reference.modes)) * np.sqrt(
        reference.model.variances[: reference.modes]
    )
    kept = replace(reference, scores=scores, names=tuple(f"c{number}" for number in range(24)))
    kept.save(tmp_path / "kept.npz")
    again = Reference.load(tmp_path / "kept.npz")
    nearest = again.nearest(scores[7])
    assert nearest[0] == ("c7", 0.0)
    assert len(nearest) == 3
    assert nearest[1][1] <= nearest[2][1]
    assert again.fingerprint == reference.fingerprint
    again.anonymous().save(tmp_path / "anonymous.npz")
    assert Reference.load(tmp_path / "anonymous.npz").nearest(scores[7]) == []


def test_scores_that_do_not_belong_to_the_controls_are_refused(reference, tmp_path):
    replace(reference, scores=np.zeros((3, reference.modes))).save(tmp_path / "bad.npz")
    with pytest.raises(InputError, match="inconsistent"):
        Reference.load(tmp_path / "bad.npz")


def test_scores_of_controls_give_their_particles_back(template):
    directions, faces = template
    random = np.random.default_rng(5)
    points = np.stack([shape(directions, random) for _ in range(6)])
    points = np.concatenate([points, points[:, ::7]], axis=1)
    columns = random.normal(size=(6, 1))
    model = SurfaceModel.fit(points, columns, 6, faces)
    scores = scores_of_points(model, points, columns)
    again = model.expected(columns[2]) + np.tensordot(scores[2], model.components, axes=1)
    np.testing.assert_allclose(again[model.vertices :], points[2, model.vertices :], atol=1e-8)


def test_a_member_is_typical_of_its_group_and_another_shape_is_not(reference, template, bumped):
    member = typicality(compare_groomed(reference, patient(template), AGE), reference)
    assert member.is_typical
    assert (member.group, member.controls) == ("NOR", 24)
    assert not typicality(bumped, reference).is_typical
    assert min(member.held_modes, member.held_outside) >= 20


def test_members_are_beyond_their_group_in_five_percent_of_cases(reference):
    random = np.random.default_rng(8)
    beyond = []
    for _ in range(400):
        logs = random.normal(scale=0.3, size=(2, 25))
        group = replace(reference, mahalanobis=np.exp(logs[0, 1:]), outside=np.exp(logs[1, 1:]))
        own = SimpleNamespace(
            measures=SimpleNamespace(mahalanobis=np.exp(logs[0, 0]), outside=np.exp(logs[1, 0]))
        )
        beyond.append(not typicality(own, group).is_typical)
    assert 0.02 < np.mean(beyond) < 0.08


def test_maps_of_thin_shapes_do_not_mix_opposite_walls(template):
    directions, faces = template
    plate = TriangleMesh(directions * [30.0, 20.0, 0.3], faces)
    turned = TriangleMesh(directions @ np.diag([-1.0, -1.0, 1.0]) * [30.0, 20.0, 0.3], faces)
    everywhere = np.ones(len(directions), bool)
    own = own_surface(turned, plate, np.zeros(len(directions)), everywhere, ~everywhere)
    values, across = own.carried(plate.vertex_normals[:, 2]), turned.vertex_normals[:, 2]
    flat = np.abs(across) > 0.9
    np.testing.assert_array_less(0.5, (values * np.sign(across))[flat])
    assert own.marked(everywhere).all()


def test_a_part_that_is_cut_off_is_shown_as_it_is_expected(template):
    directions, faces = template
    whole = TriangleMesh(directions * [30.0, 22.0, 16.0], faces)
    missing = directions[:, 0] > 0.7
    kept = faces[~missing[faces].all(axis=1)]
    own = own_surface(TriangleMesh(whole.vertices, kept), whole, np.zeros(700), ~missing, missing)
    added = len(own.mesh.vertices) - len(whole.vertices)
    assert len(own.mesh.faces) == len(faces)
    assert own.marked(missing)[-added:].all()
    assert not own.marked(missing)[:700][directions[:, 0] < 0.5].any()


def test_a_control_that_is_far_from_its_fit_is_named(template, provenance):
    directions, _ = template
    random, subjects = np.random.default_rng(6), iter(range(10))

    def subject(_):
        points = shape(directions, random)
        spiked = 12.0 * (directions @ np.array([0.0, 0.6, 0.8]) > 0.8) * (next(subjects) == 7)
        return points + spiked[:, None] * directions

    made = build(template, provenance, 10, subject)
    assert made.unlike == ("c7",)
    assert made.unlike_distances.tolist() == [made.outside[-1]]
    assert made.anonymous().unlike == ()
