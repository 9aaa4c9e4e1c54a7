"""The gallery of mechanisms in the docs: what each does to a swim, and its curve, drawn from the code.

python -m gallery --out out/gallery
"""
