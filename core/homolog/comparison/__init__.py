"""What differs: a question about a cohort's shapes, and its answer.

A `Question` (columns, groups, covariates, alignment, tests) is asked of a `Sample` (shapes and their columns,
of a project or of arrays); the `Answer` holds the tests. API, command line, window and report share them.
"""
