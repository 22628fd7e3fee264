from scipy import stats

from homolog.statistics.design import group_design
from homolog.statistics.null_simulation import null_simulation


def test_corrected_tests_hold_their_level_and_uncorrected_particles_do_not(correlated):
    shapes = correlated(subjects=21, particles=60)
    design = group_design(["a"] * 9 + ["b"] * 12, ["a", "b"])
    result = {
        item.test.partition(" (")[0]: item for item in null_simulation(shapes, design, modes=4, repeats=600)
    }
    border = stats.binom.ppf(0.999, 600, 0.05)
    for name in ("whole shape, permutation", "any particle, family-wise correction"):
        assert 5 <= result[name].false_positives <= border
        assert result[name].low <= result[name].rate <= result[name].high
    assert result["any particle, F distribution, not corrected"].rate > 0.12


def test_labels_with_a_real_effect_do_not_raise_the_false_alarm_rate(correlated):
    shapes = correlated(subjects=20)
    shapes[10:] += 4.0
    design = group_design(["a"] * 10 + ["b"] * 10, ["a", "b"])
    result = null_simulation(shapes, design, modes=3, repeats=400, permutations=1000)
    assert result[1].rate < 0.09
