"""Names that are long, of other scripts, or have signs that mean something elsewhere."""

import pytest

from homolog_app.rendering.text import legible

pytestmark = pytest.mark.window

LONG = "Jürgen Müller-Lüdenscheidt, geboren 1961, rechte Niere nach dem Umbau des Geräts " + "a" * 60
NAMES = (LONG, "Ελένη & 100 %", "山田太郎", "<b>d<_b>")


@pytest.fixture
def named(ellipsoids, groomed_cache, tmp_path, run):
    """Return a project of four shapes with such names, groups and columns."""
    from homolog.cohort import Cohort, Subject

    subjects = [
        Subject(
            name, ellipsoids / f"{file}.nrrd", group=LONG if file in "ab" else "&Ü", columns={"a & b": file}
        )
        for name, file in zip(NAMES, "abcd", strict=True)
    ]
    return run(tmp_path / "made", Cohort(tuple(subjects), ellipsoids), alignment="center")


def words_in(scene):
    """Return the captions of the views, as they are written, and how many pixels they take."""
    cells = scene.grid.cells[: scene.grid.count]
    captions = [cell.texts.caption.caption for cell in cells]
    sizes = []
    for cell, caption in zip(cells, captions, strict=True):
        size = [0.0, 0.0]
        caption.GetSize(cell.renderer, size)
        sizes.append(size[0] / cell.renderer.GetSize()[0])
    return [item.GetInput() for item in captions], sizes


def test_every_name_is_in_its_view_and_panels_stay_as_wide_as_they_are(window, named, tmp_path, wait, qapp):
    window.projects.open_paths([named])
    wait(lambda: window.workspace.session.result is not None and window.workspace.session.step == "explore")
    scene = window.views.stage.scene
    scene.picture()
    wait(lambda: all(words_in(scene)[0]))
    captions, shares = words_in(scene)
    assert captions[0].startswith("Jürgen Müller")
    assert "…" in captions[0].splitlines()[0]
    assert captions[1].startswith("Ελένη & 100 %")
    assert captions[2].startswith(legible(NAMES[2]))  # by a font of the system, or boxes
    assert max(shares) <= 1.0
    panels = window.inspector
    for step in ("cohort", "groom", "correspond", "explore"):
        window.commands[f"view.{step}"].trigger()
        window.workspace.session.select([NAMES[0]])
        assert panels.minimumSizeHint().width() <= panels.minimumWidth()
    for page in panels.explore.pages:
        panels.explore.open_page(page)
        wait(lambda: not window.workspace.session.job.is_busy)
        assert panels.minimumSizeHint().width() <= panels.minimumWidth()
    assert window.minimumSizeHint().width() <= 1100


def test_a_covariate_with_an_ampersand_is_the_column_of_that_name(window, named, wait):
    window.projects.open_paths([named])
    wait(lambda: window.workspace.session.result is not None)
    form = next(page.form for page in window.inspector.explore.pages if hasattr(page, "form"))
    (action,) = [item for item in form.adjust.menu().actions() if item.data() == "a & b"]
    action.setChecked(True)
    assert form.covariates == ("a & b",)
    assert form.adjust.text() == "Adjust for a && b"


def test_a_folder_opened_after_a_project_shows_its_input(explored, ellipsoids, wait):
    assert not explored.commands["view.raw"].isChecked()
    explored.projects.leave()
    explored.projects.open_paths([ellipsoids])
    wait(lambda: len(explored.workspace.session.surveys) == 4)
    assert explored.commands["view.raw"].isChecked()
    assert explored.views.stage.scene.grid.display.raw


def test_names_of_compared_groups_wrap_instead_of_being_cut(qapp, wait):
    from homolog_app.window.explore.group_results import AnswerTable

    table = AnswerTable("Results", ("Comparison", "D (95 % CI)", "p", "Surface"), ("",) * 4)
    table.resize(420, 300)
    table.show()
    heights = []
    for row in (("b − a", "0", "0", "0"), ("fracture − healthy", "5.12 (3.42 to 7.49) " * 2, "0.01", "43 %")):
        table.show_rows([("Form", [row])])
        for _ in range(5):
            qapp.processEvents()
        heights.append(table.visualItemRect(table.topLevelItem(0).child(0)).height())
    assert heights[1] > 1.5 * heights[0]
    table.close()


def test_a_long_note_of_grooming_has_the_lines_that_it_needs(qapp):
    from homolog_app.scenes.subjects import Triage
    from homolog_app.window.groom_panel import TriageLists

    lists = TriageLists()
    lists.show_triage(Triage({"a": ("was mirrored",), "b": ("was mirrored " * 20,)}, (), ()), "")
    lists.resize(400, 600)
    lists.show()
    for _ in range(5):
        qapp.processEvents()
    short, long = (lists.table.rowHeight(row) for row in (0, 1))
    assert long > 2.5 * short
    lists.close()


def test_buttons_of_the_cohort_have_whole_names_or_none(window, qapp):
    from PySide6.QtWidgets import QToolButton, QWidget

    from homolog_app.window.cohort_panel import CohortTools

    holder, tools, named = QWidget(), CohortTools(window.commands), []
    tools.setParent(holder)
    holder.show()
    for width in (600, 250):
        tools.resize(width, 40)
        qapp.processEvents()
        buttons = tools.findChildren(QToolButton)
        assert all(button.width() >= button.sizeHint().width() for button in buttons)
        named.append(sum("Text" in button.toolButtonStyle().name for button in buttons))
    assert named == [2, 0]
    holder.close()
