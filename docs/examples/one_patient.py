"""One shape against the controls of a project: how unusual it is, and where. For research use only.

Usage: python one_patient.py PROJECT FILE
"""

import sys

import homolog as hl

if __name__ == "__main__":  # make_reference starts processes, which import this file
    reference = hl.make_reference(sys.argv[1])  # group="NOR", adjust=["age"] if the table has them
    reference.save("reference.npz")

    patient = hl.compare_patient("reference.npz", sys.argv[2])
    print(f"{patient.name}: largest |z| {patient.local.value:.1f}, limit {reference.limit:.1f}")
    print(f"distance in the modes: percentile {patient.mahalanobis.percent:.0f} of the controls")
    for region in patient.regions:
        print(f"{region.area:.0f} mm², {region.peak:+.1f} mm, {patient.place(region)}")
    print(f"differences below about {reference.quality.limit_mm:.1f} mm are not found")
