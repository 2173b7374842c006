"""Robots that see and hear in buildings made from floor plans.

Start reading at ``robosim.episode``: one episode, whole, on one page.
"""
