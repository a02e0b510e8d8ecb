"""What is made of runs and scenes: certification, measured rates, pictures, words.

Pictures: of a run (plotting.py), of a comparison, of a scene's linear theory (stability_figure.py), the paper's Fig. 1
(figure_1.py) and Figs. 2 and 3 (paper_figures.py), and those of docs/stability_details.md (stability_examples.py).
"""
