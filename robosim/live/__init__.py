"""A local web page: radio in a building, a search as it runs, and episodes looked back on.

Drawn with viser, of the extra `live`. Whatever takes longer than a blink is done by workers of which the latest request
wins (`latest`), or by processes (`search_process`); the page's own threads only hand over what was asked for.
"""
