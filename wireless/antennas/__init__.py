"""Antennas: elements, arrays, platforms of arrays, codebooks of beams."""
