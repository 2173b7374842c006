"""A local web page: radio in a building, running searches, and recorded episodes.

The page is drawn by viser, of the extra `live`. Its own threads only forward requests: workers process the latest one
of each kind (`latest_worker`), and searches run in processes of their own (`search_process`).
"""
