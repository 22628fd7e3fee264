"""The paper's coffee-bean cohort and the figures that judge a run on it."""
