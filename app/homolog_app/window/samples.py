"""The sample studies of the start page, and what the tour says about each."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from homolog.analysis.procrustes import Alignment as ComparedPatient
from homolog.progress import Tick
from homolog.settings import Alignment, GroomSettings

__all__ = ["BEANS", "HEARTS", "Sample", "Stop"]

_COMPLETE = ".complete"
_SEED = 5
_HEARTS = 20  # of twelve, permutation tests can't show the infarct


@dataclass(frozen=True, slots=True)
class Stop:
    """A card of the tour.

    Attributes
    ----------
    step : str
        The step that it belongs to.
    title, words : str
        What it says.
    offer : str
        The command that it offers.
    opens : str
        The command that is given when it is shown, such as to open a page.
    alignment : Compared, optional
        What groups are aligned by from then on.
    """

    step: str
    title: str
    text: str
    offer: str = ""
    opens: str = ""
    alignment: ComparedPatient | None = None


@dataclass(frozen=True, slots=True)
class Sample:
    """A generated study.

    Attributes
    ----------
    name : str
        Of its folder.
    write : function of folder and tick
        Writes its files.
    stops : tuple of Stop
        The tour.
    groom, optimize : dict
        Settings other than the defaults.
    """

    name: str
    write: Callable[[Path, Tick], object]
    stops: tuple[Stop, ...]
    groom: dict[str, object] = field(default_factory=dict)
    optimize: dict[str, object] = field(default_factory=dict)

    def make(self, folder: Path, tick: Tick) -> Path:
        """Write the study, unless it is there already; return its folder."""
        if not (folder / _COMPLETE).is_file():
            self.write(folder, tick)
            (folder / _COMPLETE).touch()
        return folder

    def groom_settings(self, settings: GroomSettings) -> GroomSettings:
        """Return settings of grooming that suit the study."""
        return settings.model_copy(update=self.groom)


def _write_hearts(folder: Path, tick: Tick) -> None:
    from homolog.samples import make_study, write_study

    write_study(folder, make_study("hearts", _HEARTS, _SEED), _SEED, tick, scans=True)


def _write_beans(folder: Path, tick: Tick) -> None:
    from homolog.beans.files import write_beans
    from homolog.beans.generate import draw_beans

    write_beans(folder, draw_beans(), _SEED, tick)


_HEART_STOPS = (
    Stop(
        "cohort",
        "Twenty left ventricles",
        "Half are healthy, half have an infarct: a place where the wall is thin. Group, age and sex are in "
        "the table. Cut the hearts open with 5 to see their cavity.",
    ),
    Stop(
        "groom",
        "Smooth surfaces",
        "Grooming fills holes, smooths voxel steps and aligns the hearts. Switch between input and groomed "
        "surface with 1 and 2, see both in the scan with 4.",
        "run.groom",
    ),
    Stop(
        "correspond",
        "Corresponding particles",
        "Particles spread over all hearts at once and keep to the same places. Distances run along the "
        "surface: inside and outside of the wall stay apart.",
        "run.start",
    ),
    Stop(
        "explore",
        "What varies",
        "The modes of variation, the largest first. Move a slider, or play a mode with Space.",
        opens="explore.modes",
    ),
    Stop(
        "explore",
        "What differs",
        "Compare healthy hearts with infarcts. Hearts differ in size for other reasons, which Shape removes. "
        "Colours show where the difference is significant: the wall is thinner in the infarct.",
        "explore.test",
        "explore.groups",
        ComparedPatient.SIMILARITY,
    ),
)

_BEAN_STOPS = (
    Stop(
        "cohort",
        "Ten beans",
        "Each is an ellipsoid with a slot. Where the slot sits and how wide it is differ: two things to find "
        "out. Tick, sort and group subjects in the table.",
    ),
    Stop(
        "groom",
        "Smooth surfaces",
        "Grooming fills holes and smooths voxel steps. The beans lie alike: no alignment is needed. Switch "
        "between input and groomed surface with 1 and 2, see slices with 4.",
        "run.groom",
    ),
    Stop(
        "correspond",
        "Corresponding particles",
        "Particles spread over every bean at once and keep to the same places. Distances run along the "
        "surface: the two sides of a slot stay apart.",
        "run.start",
    ),
    Stop(
        "explore",
        "The result",
        "Equal colours mark equal places. Turn the beans with the mouse. The tab Modes shows what varies: "
        "where the slot sits, then how wide it is. Space plays it.",
    ),
)

HEARTS = Sample(f"hearts-{_HEARTS}", _write_hearts, _HEART_STOPS, optimize={"particles": 256})

# Half turned a bean fits, too: alignment would turn some.
BEANS = Sample("coffee-beans", _write_beans, _BEAN_STOPS, groom={"alignment": Alignment.NONE})
