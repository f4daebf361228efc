"""Files of other tools: episodes as OpenSCENARIO, MCAP and GIF; recorded traffic as scenarios."""
