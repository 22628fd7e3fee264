"""``python -m homolog_app``: the same as the script ``homolog``."""

import sys

from homolog_app.cli import main

sys.exit(main())
