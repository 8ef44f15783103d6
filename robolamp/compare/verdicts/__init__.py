"""Did the run do its task, and is the lamp still its twin?"""
