"""The papers' experiments: their trials, results, tables and figures, with the printed results for comparison.

Each paper has one module; ``protocols.EXPERIMENTS`` lists them. A module makes trials (one method on one take with one
loss pattern and one seed), tables and figures. ``store`` keeps the results of trials, ``plots`` draws the figures.
"""
