"""Statistics of particle arrays: shape model, parallel analysis, group tests."""
