"""The report: one HTML file that shows runs to a person, and the same curves as CSV and pictures.

Lives here: which runs belong together, the points that are plotted, the trial that is stepped
through, and the page (`assets/`: plain HTML, CSS and JavaScript, no library). Does not live here:
metrics of a run, which are `tactsim.bench.score`'s.
"""
