"""What only the comparison with published data needs: its buildings, links and labels."""
