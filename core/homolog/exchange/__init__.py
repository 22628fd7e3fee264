"""Models and landmarks to and from other programs: ShapeWorks, 3D Slicer."""

from homolog.exchange.import_model import domains_of, import_model
from homolog.exchange.markups import Markups, read_markups, write_markups
from homolog.exchange.shapeworks_export import write_shapeworks

__all__ = ["Markups", "domains_of", "import_model", "read_markups", "write_markups", "write_shapeworks"]
