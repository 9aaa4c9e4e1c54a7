"""The gallery of mechanisms in the docs: what each does to a swim, and its curve, drawn from the code.

python -m studies.gallery --out out/gallery
"""
