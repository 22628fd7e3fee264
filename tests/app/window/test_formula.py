"""Formulas put together from chips, on the real window."""

import shlex

import numpy as np
import pytest

pytestmark = [pytest.mark.window, pytest.mark.own_window]


@pytest.fixture
def page(explore, bean_project, window):
    """Return the Groups page of ten beans, whose table says where each slot is, and who scanned it."""
    from dataclasses import replace

    from homolog.beans.generate import draw_beans

    page, study = explore(bean_project, "groups"), window.workspace.session.study
    changed = {
        member.name: replace(
            member,
            subject=replace(
                member.subject,
                columns={
                    "slot": f"{bean.position:.3f}",
                    "scanner": "AB"[index % 2],
                    "site": "xxxyy"[index % 5],
                },
            ),
        )
        for index, (member, bean) in enumerate(zip(study.members, draw_beans(10), strict=True))
    }
    window.workspace.session.edit("Table", study.with_members(changed))
    page.form.column.setCurrentText("Several columns (formula)")
    page.form.column.activated.emit(page.form.column.currentIndex())
    return page


def test_chips_make_a_formula_and_a_typed_one_sets_the_chips(page):
    builder = page.form.builder
    assert builder.isVisible()
    assert not page.form.is_possible
    for name in ("slot", "scanner"):
        builder.chips[name,].click()
    assert builder.text.text() == "~ slot + scanner"
    builder.chips["slot", "scanner"].click()
    assert page.form.request.formula == "~ slot + scanner + slot:scanner"
    builder.chips["scanner",].click()  # its interaction goes with it
    assert page.form.request.formula == "~ slot"
    builder.text.setText("~ site * slot")
    builder.text.editingFinished.emit()
    assert [term for term, chip in builder.chips.items() if chip.isChecked()] == [
        ("slot",),
        ("site",),
        ("site", "slot"),
    ]
    builder.text.setText("~ slot + weight")
    builder.text.editingFinished.emit()
    assert "no column 'weight'" in builder.fault.text()
    assert not page.form.is_possible


def test_a_formula_is_answered_by_term_kept_and_shown_again(page, window, wait, own_permutations):
    builder = page.form.builder
    builder.text.setText("~ slot * scanner")
    builder.text.editingFinished.emit()
    assert page.go.text() == "Test the terms"
    window.commands["explore.test"].trigger()
    wait(lambda: bool(page.answers), seconds=300, what="for the answer")
    assert [row[0] for row in page.results.texts[1:]] == ["slot", "scanner: B − A", "slot:scanner"]
    assert page.verdict.text().startswith("slot")
    assert "Size: " in page.effect.text()
    assert page.answers[0].ends[0].startswith("slot ")
    assert page.plots.labels == ("slot", "regression score (mm)")
    page.plots.set_option("Predicted lines", True)
    assert page.plots.labels == ("slot", "predicted (mm)")
    assert set(page.plots.groups) == {"A", "B"}
    for level in "AB":  # each on a line
        own = page.plots.points[[group == level for group in page.plots.groups]]
        assert abs(np.corrcoef(own.T)[0, 1]) > 0.99
    page.choose_pair(0, 2)
    wait(lambda: page.answers[0].first == "sum of effects", seconds=100, what="for the map")
    assert "slopes of slot by scanner" in page.summary.text()
    command = page.keep.toolTip().partition("equivalent command: ")[2]
    assert shlex.split(command)[3:5] == ["--formula", "~ slot + scanner + slot:scanner"]
    page.store()
    wait(lambda: page.kept.isVisible(), seconds=100, what="for the tables")
    folder = window.workspace.project.folder / "analysis"
    assert (next(folder.glob("formula_*")) / "anova.csv").is_file()
    request = page.form.request
    page.form.column.setCurrentIndex(0)
    page.form.column.activated.emit(0)
    assert page.form.ask(request)
    assert page.form.request.formula == request.formula
