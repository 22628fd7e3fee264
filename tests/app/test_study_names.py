"""Changes of a large cohort since its result are found without comparing all names with all."""

from dataclasses import replace

from homolog_app.window.study import Member, Study, extension_of, outdated_text


class CountedName(str):
    """A name that counts its comparisons."""

    compared = 0
    __hash__ = str.__hash__

    def __eq__(self, other):
        CountedName.compared += 1
        return str.__eq__(self, other)


def test_names_are_looked_up_and_not_compared_with_each_other(finished_run):
    record = finished_run.read().result
    subject, own = finished_run.cohort().subjects[0], record.subjects[0]
    names = [CountedName(f"s{number}") for number in range(300)]
    result = record.model_copy(update={"subjects": [own.model_copy(update={"name": name}) for name in names]})
    study = Study(tuple(Member(replace(subject, name=name)) for name in names[1:]), record.settings)
    CountedName.compared = 0
    assert extension_of(study, result).subjects == ()
    assert "s0 is excluded" in outdated_text(study, result)
    assert CountedName.compared < 10 * len(names)
