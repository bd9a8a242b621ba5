"""Run time of the solver against its error, beside other solvers."""
