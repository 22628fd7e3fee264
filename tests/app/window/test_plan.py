"""The dialog *Plan a study*."""

import pytest

from homolog.comparison.plan import Plan, PlanSettings, Power
from homolog_app.window.explore.plan_dialog import PlanDialog

pytestmark = pytest.mark.window

ROW = Power(8, 0.3, 0.5, 2.0, (0.1, 0.9))
PLAN = Plan(PlanSettings(2.0, 9.0, 3), 20, (), (1.0, 2.0, 3.0), 0.8, (ROW,), None, 14, (9, None), ())


def test_the_dialog_asks_for_an_effect_and_shows_the_power(qtbot):
    asked, saved = [], []
    dialog = PlanDialog(None, asked.append, saved.append)
    qtbot.addWidget(dialog)
    dialog.show()
    dialog.go.click()
    assert dialog.problem.isVisible()
    assert not asked
    dialog.effect.setText("2")
    dialog.numbers.setText("8, 12")
    dialog.go.click()
    assert asked == [{"effect": 2.0, "width": None, "particle": None, "per_group": (8, 12)}]
    assert not dialog.save.isVisible()
    dialog.show_plan(PLAN)
    assert "14 per group (90 % interval 9 to more than 1000)" in dialog.summary.text()
    assert "more than 1000 per group to show" in dialog.summary.text()
    assert "50 (10 to 90)" in dialog.answer.text()
    dialog.save.click()
    assert saved == [PLAN]
