import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # the table of readers is shared with tests/benchmarks/fuzz.py
