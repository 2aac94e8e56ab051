"""The paper's figures and tables, made again: `python scripts/paper_page.py`."""
