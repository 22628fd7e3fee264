"""Questions about groups: what they can contain, and why they are refused."""

import pytest

from homolog.comparison.question import Question
from homolog.comparison.stored import Provenance, folder_of, stored_answers, write_question
from homolog.io.records import ProjectRecord


def test_regression_and_pairs_are_analyzed(project, capsys, analyze, rows_of):
    assert analyze(project, "--regress", "age", "--covariates", "sex", "--size", "with") == 0
    said = capsys.readouterr().out
    assert "age, adjusted for sex" in said
    assert "sex: m - f" in said
    (row,) = rows_of(project.folder / "analysis" / "regression_age_for_sex" / "covariates.csv")
    assert (row["comparison"], row["n"]) == ("sex: m - f", "18")
    assert analyze(project, "--pairs", "twin", "--between", "A", "B", "--size", "with") == 2
    assert "pair 't0' has two" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--group", "nothing"], "no column 'nothing'; the cohort has: group, shape-size, age"),
        (["--between", "A", "Z"], "no subject is in 'Z'; groups are: A, B, C"),
        (["--group", "site"], "one group only"),
        (["--regress", "sex"], "contains text"),
        (["--regress", "code:c"], "compare the groups of 'code' instead"),
        (["--regress", "site"], "is the same for all compared subjects"),
        (["--regress", "grade"], "no value for subject 7"),
        (["--covariates", "grade"], "no value for subject 7"),
        (["--covariates", "site"], "'site' is the same for all compared subjects"),
        (["--group", "age", "--between", "40", "42"], "'40' has 1 of the two or more subjects"),
        (["--modes", "17"], "17 modes are more than the 15"),
        (["--modes", "0"], "--modes 0: must be at least 1"),
        (["--pairs", "twin"], "between two values of column 'group'; choose two of: A, B, C"),
        (["--pairs", "twin", "--between", "X", "Y"], "no subject is in 'X'; groups are: A, B, C"),
        (["--pairs", "twin", "--regress", "age"], "can't be combined with a regression"),
        (["--pairs", "halves", "--between", "A", "B"], "'halves': no pair for subject 1; fill it in"),
        (["--covariates", "age", "age"], "'age' is given twice"),
        (["--covariates", "dose"], "'dose' contains numbers, but also '30 y' of subject 3"),
        (["--covariates", "weight"], "'inf' of subject 2 is not finite"),
        (["--size", "with", "--alignment", "form"], "give one of them"),
    ],
)
def test_a_question_that_cannot_be_answered_is_refused_and_not_kept(
    project, options, message, capsys, analyze
):
    assert analyze(project, *options) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert not list(project.folder.rglob("study.json"))


def test_spellings_of_a_declared_category_are_told_and_those_of_a_number_are_not(project, capsys, analyze):
    assert analyze(project, "--between", "A", "B", "--covariates", "scanner:c", "--size", "with") == 0
    assert "'scanner' contains '1' and '1.0', which were treated as different" in capsys.readouterr().out
    assert analyze(project, "--between", "A", "B", "--covariates", "scanner", "--size", "with") == 0
    assert "treated as different" not in capsys.readouterr().out


def test_subjects_without_a_value_are_left_out_by_choice_and_counted(project, capsys, analyze, rows_of):
    question = ["--covariates", "grade:c", "--between", "A", "B", "--size", "with"]
    assert analyze(project, *question) == 2
    assert analyze(project, *question, "--complete-cases") == 0
    assert "1 subject was excluded for missing values" in capsys.readouterr().out
    (folder,) = (project.folder / "analysis").iterdir()
    (test,) = rows_of(folder / "tests.csv")
    assert (test["n"], test["complete_cases"]) == ("11", "1")
    gone = {row["name"]: row["left_out_because"] for row in rows_of(folder / "subjects.csv")}
    assert gone["subject 7"] == "no value of grade"
    assert analyze(project, "--regress", "grade", "--size", "with", "--complete-cases") == 0
    (test,) = rows_of(project.folder / "analysis" / "regression_grade_complete_cases" / "tests.csv")
    assert test["n"] == "17"
    assert test["unit"] == "per unit of grade"


def test_subjects_without_a_partner_are_said_to_be_left_out_for_that(project, capsys, analyze):
    question = ["--pairs", "twin", "--between", "A", "B", "--size", "with", "--complete-cases"]
    record = project.read().result
    subjects = [
        subject.model_copy(
            update={"columns": {**subject.columns, "twin": f"t{index // 3}" if index != 3 else "t9"}}
        )
        for index, subject in enumerate(record.subjects)
    ]
    project.write(ProjectRecord(result=record.model_copy(update={"subjects": subjects})))
    assert analyze(project, *question) == 0
    said = capsys.readouterr().out
    assert "2 subjects were excluded because the other one of their pair is missing" in said
    assert "missing values" not in said


def test_numbers_that_are_declared_categories_become_columns(project, analyze, rows_of):
    for name, covariate in (("number", "code"), ("category", "code:c")):
        assert analyze(project, "--between", "A", "B", "--size", "with", "--covariates", covariate) == 0, name
    folders = sorted((project.folder / "analysis").iterdir())
    dof = [int(float(rows_of(folder / "tests.csv")[0]["f_dof_denominator"])) for folder in folders]
    modes = [int(rows_of(folder / "tests.csv")[0]["modes"]) for folder in folders]
    assert dof[0] + modes[0] == dof[1] + modes[1] + 1


def test_a_covariate_that_is_the_same_within_one_pair_of_groups_is_told_not_refused(project, capsys, analyze):
    assert analyze(project, "--covariates", "half", "--size", "with") == 0
    assert "B - A: half: the same" in capsys.readouterr().out


def test_a_column_called_size_is_the_users_own(project, capsys, analyze):
    record = project.read()
    subjects = [
        subject.model_copy(update={"columns": {**subject.columns, "size": str(index % 5)}})
        for index, subject in enumerate(record.result.subjects)
    ]
    project.write(
        record.model_copy(update={"result": record.result.model_copy(update={"subjects": subjects})})
    )
    assert analyze(project, "--regress", "size", "--size", "with") == 0
    said = capsys.readouterr().out
    assert "'shape-size'" in said
    assert "Size: " in said
    assert analyze(project, "--regress", "shape-size", "--size", "with") == 0
    assert "Size: " not in capsys.readouterr().out  # against itself


def test_no_answer_overwrites_that_of_another_question(project):
    long = [f"{'a very long name of a group ' * 5}{item}" for item in "AB"]
    questions = [
        Question(between=tuple(long)),
        Question(between=(long[0], long[0] + "C")),
        Question(between=tuple(long), alignment="form"),
        Question(between=("a b", "c")),
        Question(between=("a", "b c")),
        Question(kind="pairs", between=("A", "B"), pairs="twin"),
        Question(kind="pairs", between=("A", "B"), pairs="couple"),
        Question(seed=3),
        Question(seed=4),
    ]
    folders = []
    for entry in questions:
        folders.append(folder_of(project, entry))
        write_question(entry, folders[-1], Provenance.now(project))
    assert len(set(folders)) == len(questions)
    assert [folder_of(project, question) for question in questions] == folders
    assert max(len(folder.name) for folder in folders) < 140
    kept, damaged = stored_answers(project)
    assert not damaged
    assert {stored.question.identity for stored in kept} == {question.identity for question in questions}
