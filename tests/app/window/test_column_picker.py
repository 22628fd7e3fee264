"""The list of columns on a button."""


def test_columns_are_ticked_and_unusable_ones_say_why(qapp):
    from homolog_app.window.explore.controls import ColumnPicker

    picker = ColumnPicker("Columns to adjust for", "", lambda names: ", ".join(names) or "Nothing")
    picker.offer({"age": "", "sex": "", "site": "The same for all subjects"})
    actions = {action.data(): action for action in picker.menu().actions()}
    assert picker.text() == "Nothing"
    assert not actions["site"].isEnabled()
    assert actions["site"].toolTip() == "The same for all subjects"
    for name in ("age", "sex"):
        actions[name].trigger()
    assert picker.text() == "age, sex"
    picker.offer({"sex": "", "height": ""})
    assert picker.chosen == ["sex"]
