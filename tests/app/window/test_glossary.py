"""Technical words of the window have their sentence in the glossary."""

from homolog_app.window.glossary import explanation, sentences


def test_the_terms_of_a_text_are_explained_in_its_order():
    lines = explanation("Severity of folded faces").splitlines()
    assert [line.partition(":")[0] for line in lines] == ["Severity", "Folded"]
    assert explanation("Closest points (ICP)").count("\n") == 0
    assert explanation("Save as…") == ""
    assert explanation("Particles").startswith("Particle: a point on a surface")


def test_sentences_are_plain_text():
    assert len(sentences()) > 40
    assert not any(sign in text for text in sentences().values() for sign in ("](", "`", "*", "|"))


def test_words_that_reviewers_did_not_know_have_a_sentence():
    words = (
        *("medoid", "parallel analysis", "spacing", "handle", "discriminant", "verdict", "coherence"),
        *("D = 1.8 (90 % CI 1 to 3)", "Mahalanobis D", "F(3, 18)", "Hotelling's T²", "AUC", "p < 0.001", "z"),
        *("at a false discovery rate of 5 %", "Dispersion", "Balanced accuracy", "± 2 SD", "Seeds", "Power"),
        *("Within strata", "Main effects", "Interactions", "Procrustes", "Tunnels", "10000 permutations"),
        "Holm's correction",
    )
    for word in words:
        assert explanation(word), word
    assert not explanation("3-D views")
