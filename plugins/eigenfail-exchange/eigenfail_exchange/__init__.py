"""Single episodes as files of other tools: OpenSCENARIO and OpenDRIVE, MCAP, GIF."""
