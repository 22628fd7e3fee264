import csv

from homolog.io.tables import write_table


def test_numbers_keep_all_digits_and_names_with_commas_are_quoted(tmp_path):
    path = tmp_path / "scores.csv"
    write_table(path, ["name", "mode_1", "note"], [["a,b", 1.0 / 3.0, None], ['say "x"', 2, "Ä"]])
    with path.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    assert rows[0] == ["name", "mode_1", "note"]
    assert float(rows[1][1]) == 1.0 / 3.0
    assert [rows[1][0], rows[1][2], *rows[2]] == ["a,b", "", 'say "x"', "2", "Ä"]
