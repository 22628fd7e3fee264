"""Sample studies: generated anatomy of known correspondence and known differences between groups."""

from homolog.samples.study import SampleStudy, SampleSubject
from homolog.samples.write import KINDS, make_study, write_study

__all__ = ["KINDS", "SampleStudy", "SampleSubject", "make_study", "write_study"]
