"""The paper's coffee-bean cohort and its metrics."""
