"""Quality and speed of the optimizer, on beans and on real cohorts.

    python tests/benchmarks/optimizer.py shapes FOLDER   groom once: beans and real cohorts, as npz
    python tests/benchmarks/optimizer.py quality FOLDER  every method on five bean cohorts
    python tests/benchmarks/optimizer.py seeds FOLDER    256 particles, 20 seeds; the narrow beans
    python tests/benchmarks/optimizer.py real FOLDER     landmarks of vertebrae, walls of ventricles
    python tests/benchmarks/optimizer.py speed FOLDER    time and memory by shapes and particles (--plot PNG)
    python tests/benchmarks/optimizer.py whole FOLDER    seconds of whole optimizations

All but the first take --device; they need only numpy, scipy, warp-lang and pydantic. The last two groom the
beans that they need if the folder has none. Larger cohorts of ``speed`` are ten beans over and over, each
copy with a distance field, a geodesic table and jittered particles of its own; ``whole`` draws other beans.
"""

import argparse
import csv
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from growth_plot import draw_growth
from ventricle_walls import wall_swaps

from homolog.beans.evaluate import evaluate
from homolog.beans.generate import NARROW, WIDE, draw_beans
from homolog.correspondence import Shape, optimize
from homolog.correspondence.divided import make_engine, prepare_on
from homolog.correspondence.entropy.sampling import LIST_ITERATIONS
from homolog.correspondence.entropy.terms import Term
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.schedule import Weights
from homolog.device import choose_device, describe_device
from homolog.geometry import farthest_point_sampling
from homolog.progress import no_tick
from homolog.settings import GroomSettings, Method, OptimizeSettings
from homolog.statistics.thin_plate import landmark_errors as errors_of_landmarks
from homolog.surfaces.closest import closest_points
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh

DATA = Path(os.environ.get("HOMOLOG_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
COHORTS = (1, 2, 3, 5, 12)
REAL = {"vertebrae": "vertebra_l1_verse/meshes", "ventricles": "lv_acdc_dev/myo_iso"}


def make_beans(folder, geometry, seed, count=10):
    """Groom beans once; return their file."""
    from homolog.beans.files import write_beans

    with tempfile.TemporaryDirectory() as place:
        cohort = write_beans(Path(place), draw_beans(count, seed, geometry), seed)
        path = folder / f"{geometry.name}{seed}{'' if count == 10 else f'x{count}'}.npz"
        save(path, cohort, GroomSettings(alignment="none"))
    return path


def make_shapes(folder):
    """Groom every cohort once."""
    from homolog.cohort import read_cohort

    for geometry in (WIDE, NARROW):
        for seed in COHORTS if geometry is WIDE else (5,):
            make_beans(folder, geometry, seed)
    for name, path in REAL.items():
        save(folder / f"{name}.npz", read_cohort(DATA / path), GroomSettings())


def save(path, cohort, settings):
    """Groom a cohort and store what the optimizer needs."""
    from homolog.grooming import groom_cohort
    from homolog.registration import align_cohort

    start = time.perf_counter()
    groomed = groom_cohort(cohort, settings, cache=None)
    groomed, alignments = align_cohort(cohort, groomed, settings)
    arrays = {"names": [item.name for item in groomed], "alignments": alignments}
    for k, entry in enumerate(groomed):
        values = np.clip(entry.field.values, -5 * entry.field.spacing, 5 * entry.field.spacing)
        arrays |= {f"values{k}": values.astype(np.float16), f"grid{k}": entry.field.index_to_world}
        arrays |= {f"vertices{k}": entry.mesh.vertices.astype(np.float32), f"faces{k}": entry.mesh.faces}
        arrays |= {f"coarse_vertices{k}": entry.coarse_mesh.vertices.astype(np.float32)}
        arrays |= {f"coarse_faces{k}": entry.coarse_mesh.faces}
    np.savez_compressed(path, **arrays)
    print(f"{path.name}: {len(groomed)} shapes, {time.perf_counter() - start:.1f} s", flush=True)


def load(path):
    """Read stored shapes."""
    a = np.load(path)
    return [
        Shape(
            str(name),
            DistanceField(a[f"values{k}"].astype(np.float32), a[f"grid{k}"]),
            TriangleMesh(a[f"vertices{k}"], a[f"faces{k}"]),
            TriangleMesh(a[f"coarse_vertices{k}"], a[f"coarse_faces{k}"]),
            a["alignments"][k],
        )
        for k, name in enumerate(a["names"])
    ]


DEFAULTS = {}  # settings that the command line gives for all runs


def timed(shapes, device, tick=no_tick, **options):
    """Optimize; return the correspondence and the seconds."""
    start = time.perf_counter()
    result = optimize(shapes, OptimizeSettings(**DEFAULTS, **options), device=device, tick=tick)
    return result, time.perf_counter() - start


BEAN_HEAD = (
    "| cohort, method | leak % | linear % | lowest % | R² p | R² w | var | fill | n > 90° % | swap % "
    "| distance mean / p95 | nn_cv | s |\n|" + "---|" * 13
)


def bean_row(title, runs):
    """Print the medians over runs of (figures, seconds)."""
    names = ("leak", "ground_truth_r2", "r2_position", "r2_width", "var_per_particle", "slot_fill")
    names += ("normals_over_90_pairs", "wall_swap", "distance_mean", "distance_p95", "nn_cv", "cover_max")
    median = {name: float(np.median([getattr(figures, name) for figures, _ in runs])) for name in names}
    lowest = min(figures.ground_truth_r2 for figures, _ in runs)
    print(
        f"| {title} | {100 * median['leak']:.2f} | {100 * median['ground_truth_r2']:.2f} "
        f"| {100 * lowest:.2f} | {median['r2_position']:.4f} | {median['r2_width']:.4f} "
        f"| {median['var_per_particle']:.1f} "
        f"| {median['slot_fill']:.2f} | {100 * median['normals_over_90_pairs']:.3f} "
        f"| {100 * median['wall_swap']:.3f} | {median['distance_mean']:.3f} / {median['distance_p95']:.3f} "
        f"| {median['nn_cv']:.3f} | {np.median([seconds for _, seconds in runs]):.1f} |",
        flush=True,
    )


def quality(folder, device, seeds):
    """Every method on the wide cohorts, 1024 particles."""
    print(BEAN_HEAD)
    for method in (Method.GEODESIC_NORMALS, Method.NORMALS, Method.GEODESIC, Method.EUCLIDEAN):
        everything = []
        for cohort in COHORTS:
            beans, shapes = draw_beans(10, cohort, WIDE), load(folder / f"wide{cohort}.npz")
            runs = []
            for seed in range(seeds):
                result, seconds = timed(shapes, device, method=method, particles=1024, seed=seed)
                runs.append((evaluate(result.local, beans), seconds))
            everything += runs
            if method is Method.GEODESIC_NORMALS:
                bean_row(f"{cohort}, {method.value}", runs)
        bean_row(f"all, {method.value}", everything)


def many_seeds(folder, device):
    """No bad seeds at 256 particles; the narrow geometry."""
    print(BEAN_HEAD)
    for name, cohort, particles, seeds in (
        ("wide", 5, 256, 20),
        ("wide", 12, 256, 20),
        ("narrow", 5, 1024, 5),
    ):
        beans = draw_beans(10, cohort, WIDE if name == "wide" else NARROW)
        shapes = load(folder / f"{name}{cohort}.npz")
        runs = []
        for seed in range(seeds):
            result, seconds = timed(shapes, device, particles=particles, seed=seed)
            runs.append((evaluate(result.local, beans), seconds))
        bean_row(f"{name} {cohort}, {particles} particles, {seeds} seeds", runs)


def real(folder, device, seeds):
    """Landmark transfer on vertebrae, swapped walls on ventricles."""
    vertebrae, ventricles = (load(folder / f"{name}.npz") for name in REAL)
    for method in (Method.GEODESIC_NORMALS, Method.EUCLIDEAN):
        for particles, seed in ((n, seed) for n in (512, 1024) for seed in range(seeds)):
            options = {"method": method, "particles": particles, "seed": seed}
            title = f"{method.value}, {particles}, seed {seed}"
            result, seconds = timed(vertebrae, device, **options)
            errors = landmark_errors(vertebrae, result.local)
            middle, each = np.nanmedian(errors), np.round(np.nanmean(errors, axis=(0, 1)), 1)
            print(
                f"vertebrae, {title}: landmarks mean {np.nanmean(errors):.2f} mm, median {middle:.2f}", end=""
            )
            print(f", by landmark {each}, opposed normals {opposed(result.normals):.3f} %, {seconds:.1f} s")
            print(where_errors(vertebrae, errors), flush=True)
            result, seconds = timed(ventricles, device, **options)
            share, count = wall_swaps(ventricles, result)
            print(f"ventricles, {title}: swapped walls {share:.4f} % of pairs, {count} particles", end="")
            print(f", opposed normals {opposed(result.normals):.3f} %, {seconds:.1f} s", flush=True)


def expert_landmarks(shapes):
    """Read the vertebrae's landmarks, (M, 10, 3)."""
    table = {}
    with (DATA / "vertebra_l1_verse" / "landmarks.csv").open() as file:
        for row in csv.DictReader(file):
            table.setdefault(row["id"], {})[row["landmark"]] = [float(row[axis]) for axis in "xyz"]
    return np.array([[v for _, v in sorted(table[shape.name.split("_")[0]].items())] for shape in shapes])


def landmark_errors(shapes, particles):
    """Distances [mm] of landmarks carried by thin plates through the particles, snapped to the surface."""
    return errors_of_landmarks(
        particles, expert_landmarks(shapes), [partial(closest_points, s.mesh) for s in shapes]
    )


def where_errors(shapes, errors):
    """Tell the means of transfers from, to and among the subjects whose landmarks mean something else."""
    rest, lines = errors.copy(), []
    for landmarks, ids in (("EF", ("verse016", "verse018")), ("AD", ("verse023",))):
        columns = ["ABCDEFGHIJ".index(name) for name in landmarks]
        odd = np.array([shape.name.startswith(ids) for shape in shapes])
        across = odd[:, None] != odd[None, :]
        some = errors[..., columns]
        lines.append(
            f"    {landmarks} between {', '.join(ids)} and the others {np.nanmean(some[across]):.2f} mm, "
            f"among the others {np.nanmean(some[~odd][:, ~odd]):.2f}"
        )
        for column in columns:
            rest[..., column][across] = np.nan
    return "\n".join([*lines, f"    all but those transfers {np.nanmean(rest):.2f}"])


def opposed(normals):
    """Share of (particle, pair of shapes) with opposed normals [%]."""
    pairs = [(normals[i] * normals[j]).sum(axis=-1) < 0 for i in range(len(normals)) for j in range(i)]
    return 100.0 * float(np.mean(pairs))


SIZES = ("10x256", "10x1024", "10x4096", "10x8192", "50x1024", "100x1024", "200x1024", "500x1024")


def speed(folder, device, sizes, iterations, plot):
    """Time and memory of an iteration against shapes and particles, each size in a process of its own."""
    print("| shapes | particles | ms an iteration | processor ms | prepared s | tables GB | peak GB |")
    print("|" + "---|" * 7, flush=True)
    rows = []
    for size in sizes:
        arguments = [sys.executable, __file__, "size", str(folder), "--device", device, "--sizes", size]
        arguments += ["--iterations", str(iterations)]
        row = json.loads(
            subprocess.run(arguments, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()[-1]
        )
        rows.append(row)
        print(
            "| {shapes} | {particles} | {wall:.1f} | {processor:.1f} | {prepared:.1f} | {tables:.2f} "
            "| {peak:.2f} |".format(**row),
            flush=True,
        )
    if plot is not None:
        draw_growth(rows, device, plot)


def one_size(folder, device, size, iterations):
    """Measure one size and print it as JSON."""
    import warp as wp

    count, particles = map(int, size.split("x"))
    before = memory()
    start = time.perf_counter()
    engine = an_engine(folder, device, count, particles)
    prepared, tables = time.perf_counter() - start, memory() - before
    groups = max(1, iterations // LIST_ITERATIONS)
    engine.start_stage([Weights(Term(0.02, 1.0), Term(0.05, 0.1), 0.5)] * (3 * groups * LIST_ITERATIONS))
    for _ in range(groups):
        engine.iterate()
    wp.synchronize()
    wall, processor = time.perf_counter(), time.process_time()
    for _ in range(groups):
        engine.iterate()
    wp.synchronize()
    each = 1000.0 / (groups * LIST_ITERATIONS)
    row = {
        "shapes": count,
        "particles": particles,
        "wall": (time.perf_counter() - wall) * each,
        "processor": (time.process_time() - processor) * each,
        "prepared": prepared,
        "tables": tables,
        "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }
    engine.launch.close()
    print(json.dumps(row))


def an_engine(folder, device, count, particles):
    """Return an engine with particles spread over so many beans, copies of ten."""
    base = load(folder / "wide5.npz")
    shapes = [base[k % len(base)] for k in range(count)]
    devices = device.split(",")
    cohort = prepare_on(devices, shapes, OptimizeSettings(particles=particles), counts=[particles])
    surface_set = cohort.surface_set(particles)
    chosen = [
        farthest_point_sampling(m.vertices, min(particles, len(m.vertices)))
        for m in surface_set.meshes[: len(base)]
    ]
    rows = [np.resize(chosen[k % len(base)], particles) for k in range(count)]
    jitter = np.random.default_rng(0).normal(scale=0.3, size=(count, particles, 3))
    positions = np.stack([m.vertices[row] for m, row in zip(surface_set.meshes, rows, strict=True)]) + jitter
    return make_engine(cohort, positions, Launcher(devices[0]), np.tile(np.eye(4), (count, 1, 1)), None)


def memory():
    """Memory of this process [GB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**30


def whole(folder, device, sizes, copies_of):
    """Time whole optimizations of beans; each is run twice, as the first may compile kernels.

    With `copies_of` the shapes are copies of so many beans, aligned in the run, and optimized once.
    """
    for size in sizes:
        count, particles = map(int, size.split("x"))
        beans = copies_of or count
        path = folder / ("wide5.npz" if beans == 10 else f"wide5x{beans}.npz")
        shapes = load(path if path.exists() else make_beans(folder, WIDE, 5, beans))
        options = {"particles": particles}
        if copies_of:
            shapes = [replace(shapes[k % beans], name=f"copy{k}") for k in range(count)]
            options |= {"procrustes": "form", "tick": logged()}
        else:
            timed(shapes, device, **options)
        result, seconds = timed(shapes, device, **options)
        print(
            f"whole optimization {size}, geodesics and start included: {seconds:.2f} s, "
            f"{result.iterations} iterations, {result.reason.value}, energies {result.energies[-1]}, "
            f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.1f} GB",
            flush=True,
        )


def logged(interval=10.0):
    """Return a tick that prints the progress now and then."""
    start, last = time.perf_counter(), [0.0]

    def tick(fraction, text):
        now = time.perf_counter() - start
        if now > last[0] + interval:
            last[0] = now
            print(f"{now:6.0f} s {100 * fraction:5.1f} % {text}", flush=True)

    return tick


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["shapes", "quality", "seeds", "real", "speed", "size", "whole"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", default="auto")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--sizes", nargs="+", metavar="SHAPESxPARTICLES", help="for speed and whole")
    parser.add_argument("--iterations", type=int, default=100)
    parser.add_argument("--copies-of", type=int, metavar="BEANS", help="for whole: copies of so many beans")
    parser.add_argument("--opening-weight", type=float, help="of opening angles, for all runs")
    parser.add_argument("--plot", type=Path)
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    if arguments.what == "shapes":
        make_shapes(arguments.folder)
        return 0
    if arguments.what in ("speed", "size", "whole") and not (arguments.folder / "wide5.npz").exists():
        make_beans(arguments.folder, WIDE, 5)
    if arguments.opening_weight is not None:
        DEFAULTS["opening_weight"] = arguments.opening_weight
    device = choose_device(arguments.device)
    if arguments.what == "size":
        one_size(arguments.folder, device, arguments.sizes[0], arguments.iterations)
        return 0
    print(describe_device(device))
    if arguments.what == "quality":
        quality(arguments.folder, device, arguments.seeds)
    elif arguments.what == "real":
        real(arguments.folder, device, arguments.seeds)
    elif arguments.what == "speed":
        speed(arguments.folder, device, arguments.sizes or SIZES, arguments.iterations, arguments.plot)
    elif arguments.what == "whole":
        whole(arguments.folder, device, arguments.sizes or ("10x256", "10x1024"), arguments.copies_of)
    else:
        many_seeds(arguments.folder, device)
    return 0


if __name__ == "__main__":
    sys.exit(main())
