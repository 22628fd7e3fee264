"""How long a slider of the modes takes: from its value to vertices, and to the picture.

    python tests/benchmarks/mode_slider.py [--vertices 20000 --modes 10 --moves 60]

Ellipsoids with lumps make a model of so many vertices. Prints the rows
of docs/window.md; CPU is that of all the process's threads. Needs a display (Xvfb will do).
"""

import argparse
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

_AXES = np.array([40.0, 25.0, 20.0])
_LUMPS = 12
_PLAY_S = 10.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vertices", type=int, default=20_000)
    parser.add_argument("--subjects", type=int, default=24)
    parser.add_argument("--particles", type=int, default=1024)
    parser.add_argument("--modes", type=int, default=10)
    parser.add_argument("--moves", type=int, default=60)
    options = parser.parse_args()
    shape = lumpy_model(options.subjects, options.particles, options.vertices)
    parts = time_parts(shape, options.modes, options.moves)
    with tempfile.TemporaryDirectory() as folder:
        parts |= time_window(shape, Path(folder), options.moves)
    print(f"{len(shape.mean.vertices)} vertices, {options.modes} modes; median, 95th percentile [ms]")
    for name, values in parts.items():
        print(f"| {name} | {np.median(values):.2f} | {np.percentile(values, 95):.2f} |")


def lumpy_model(subjects: int, particles: int, vertices: int):
    """Return the model of ellipsoids with lumps, on a mean surface with so many vertices."""
    from scipy.spatial import ConvexHull

    from homolog.io.results import Result
    from homolog.settings import Method
    from homolog.surfaces.mesh import TriangleMesh
    from homolog_app.scenes.model_shape import fit_model_shape

    generator = np.random.default_rng(0)
    points, surface = even_points(particles), even_points(vertices)
    waves = np.sin(2.0 * points @ generator.normal(size=(3, _LUMPS)))
    amounts = generator.normal(size=(subjects, _LUMPS)) / np.arange(1, _LUMPS + 1)
    world = points * _AXES * (1.0 + 0.05 * (amounts @ waves.T))[:, :, None]
    hull = ConvexHull(surface)
    faces = hull.simplices.copy()
    a, b, c = (surface[faces[:, corner]] for corner in range(3))
    inward = np.einsum("fi,fi->f", hull.equations[:, :3], np.cross(b - a, c - a)) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    names = tuple(f"subject_{index}" for index in range(subjects))
    places = np.tile(np.eye(4), (subjects, 1, 1))
    mean = TriangleMesh(surface * _AXES, faces)
    smoothing = np.zeros(world.shape[1])
    result = Result(names, (None,) * subjects, ({},) * subjects, world, world, places, mean, smoothing)
    return fit_model_shape("lumps", Method.GEODESIC_NORMALS, result)


def even_points(count: int):
    """Return points spread evenly on the unit sphere, (count, 3)."""
    height = 1.0 - 2.0 * (np.arange(count) + 0.5) / count
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    across = np.sqrt(1.0 - height**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), height])


def time_parts(shape, modes: int, moves: int) -> dict[str, list[float]]:
    """Time the computing alone [ms]: to vertices, normals, and the content with its colours."""
    generator = np.random.default_rng(1)
    places = [generator.uniform(-2.0, 2.0, modes) for _ in range(moves)]

    def vertices(at):
        return shape.mean.vertices.astype(np.float32) + shape.moved(at)

    return {
        **timed("vertices", vertices, places),
        **timed("vertices and normals", lambda at: shape.normals(vertices(at)), places),
        **timed("vertices, normals and colours", lambda at: content(shape, at), places),
    }


def content(shape, deviations):
    """Return what the views are given."""
    from homolog_app.scenes.shapes import mode_scene
    from homolog_app.scenes.states import ModesView

    return mode_scene(ModesView(deviations=tuple(deviations)), [shape])


def timed(name: str, work, arguments) -> dict[str, list[float]]:
    """Return how long each call takes, on the clock and of the processors [ms]."""
    clock, spent = [], []
    for argument in arguments:
        began, used = time.perf_counter(), time.process_time()
        work(argument)
        clock.append(1000.0 * (time.perf_counter() - began))
        spent.append(1000.0 * (time.process_time() - used))
    return {name: clock, f"{name}, CPU": spent}


def time_window(shape, folder: Path, moves: int) -> dict[str, list[float]]:
    """Time slider to picture in the real window, then how late events are while a mode plays [ms]."""
    from homolog_app.window.explore.controls import Player
    from homolog_app.window.scene import Scene
    from homolog_app.window.start import make_application, make_window

    app = make_application()
    window = make_window(app, folder)
    window.load_views()
    scene: Scene = window.views.stage.scene
    scene.setParent(None)
    scene.resize(910, 520)
    scene.show()

    def draw(value: float) -> None:
        scene.display(content(shape, np.array([value, 0.5])))

    def show(value: float) -> None:
        draw(value)
        scene.plot.grabFramebuffer()

    times = timed("slider to picture", show, 2.0 * np.sin(np.arange(moves) / 9.0))
    times |= timed("a picture alone", lambda _: scene.plot.grabFramebuffer(), range(moves))
    player = Player(window.commands, lambda: scene.plot.draw_ms, {"": 2.0})
    player.swung.connect(draw)
    player.play_or_stop()
    times["event late while playing"] = lateness(app, _PLAY_S)
    player.stop()
    scene.close_scene()
    window.views = None
    window.close()
    return times


def lateness(app, seconds: float) -> list[float]:
    """Return how late the window's thread handles events that another posts every 20 ms [ms]."""
    from PySide6.QtCore import QEvent, QObject

    late: list[float] = []

    class Receiver(QObject):
        def customEvent(self, event: QEvent) -> None:
            late.append(1000.0 * (time.perf_counter() - event.posted))

    class Posted(QEvent):
        def __init__(self) -> None:
            super().__init__(QEvent.Type.User)
            self.posted = time.perf_counter()

    receiver, end = Receiver(), time.perf_counter() + seconds

    def post() -> None:
        while time.perf_counter() < end:
            app.postEvent(receiver, Posted())
            time.sleep(0.02)

    thread = threading.Thread(target=post)
    thread.start()
    while thread.is_alive():
        app.processEvents()
        time.sleep(0.0005)
    thread.join()
    app.processEvents()
    return late


if __name__ == "__main__":
    main()
