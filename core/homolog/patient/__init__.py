"""One patient against a population: a frozen reference, a robust fit, and the comparison."""

from homolog.patient.compare import PatientComparison, compare_groomed, compare_patient
from homolog.patient.distribution import Percentile
from homolog.patient.follow_up import Change, FollowUp, compare_times
from homolog.patient.joint import (
    JointComparison,
    JointReference,
    PatientPose,
    compare_joint_patient,
    make_reference,
    read_reference,
)
from homolog.patient.local import Region
from homolog.patient.reference import Reference
from homolog.patient.typicality import Typicality, typicality

__all__ = [
    "Change",
    "FollowUp",
    "JointComparison",
    "JointReference",
    "PatientComparison",
    "PatientPose",
    "Percentile",
    "Reference",
    "Region",
    "Typicality",
    "compare_groomed",
    "compare_joint_patient",
    "compare_patient",
    "compare_times",
    "make_reference",
    "read_reference",
    "typicality",
]
