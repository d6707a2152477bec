"""What is unknown with one effect may be several: those need not earn what several cost then."""

from types import SimpleNamespace

import pytest

from hil.gap.fits.evidence import MORE
from hil.gap.judged.verdict import or_several


def diagnosis(verdict, gain, count):
    best = SimpleNamespace(leaves=("effect",) * count)
    causes = (SimpleNamespace(gain=gain),) * count
    effects = () if verdict == "unknown" else causes
    return SimpleNamespace(verdict=verdict, best=best, causes=causes, effects=effects)


ONE, TWO = SimpleNamespace(leaves=("a",)), SimpleNamespace(leaves=("a", "b"))


@pytest.mark.parametrize(
    ("verdict", "gain", "is_several"),
    [("identified", 20.0, True), ("identified", 20.0 - MORE, False), ("unknown", 30.0, False)],
)
def test_more_effects_are_taken_where_they_explain_it_and_are_not_much_less_likely(
    verdict, gain, is_several
):
    found, several, asked = diagnosis("unknown", 20.0, 1), diagnosis(verdict, gain, 2), []

    def answered(fits):
        asked.append(fits)
        return several

    assert or_several(found, [ONE, TWO], answered) is (several if is_several else found)
    assert asked == [[TWO]]


@pytest.mark.parametrize("verdict", ["identified", "ambiguous", "no_gap"])
def test_what_is_known_is_not_asked_again(verdict):
    found = diagnosis(verdict, 20.0, 1)
    assert or_several(found, [ONE, TWO], lambda fits: pytest.fail("asked")) is found


def test_where_none_has_more_effects_it_stays_unknown():
    found = diagnosis("unknown", 20.0, 1)
    assert or_several(found, [ONE], lambda fits: pytest.fail("asked")) is found
