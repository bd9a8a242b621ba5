"""Files: read once, written whole, deleted only where that is allowed.

In the order in which data passes:

- `input_file`: Input files, read once, and the files that they name.
- `picture_tags`: What the header of a picture's file says: size, pages, white as zero, orientation.
- `silence`: Silence of decoders in C, which print past Python what is wrong with a file.
- `radiance_file`: Radiance pictures: the radiances, whatever was done to the numbers.
- `picture_file`: Pictures in files, decoded by one function, as they are stored or as grey images.
- `recording`: The frames of a file, read when they are asked for, and when each was taken.
- `raw_frames`: Frames that cameras store as the sensor gave them, 10 and 12 bits often packed.
- `video_container`: Videos in containers: AVI, Matroska, MP4 and MOV.
- `photron_file`: Photron's recordings: .cih or .cihx with .mraw or pictures.
- `cine_file`: Vision Research's recordings: .cine.
- `frame_source`: Pictures of one camera as a sequence: a folder, files, stacks, videos, arrays.
- `hdf5_file`: HDF5 files: read whole, as arrays and attributes, and written to full disks.
- `output_folder`: The output folder: what may be written and deleted in it, and who is writing.
- `atomic_files`: Files that are either whole or absent.
- `cache_files`: The user's cache folder, and the files in caches: what gpusim can do without.
"""
