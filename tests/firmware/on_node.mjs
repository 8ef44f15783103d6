// Runs the firmware on MicroPython's WebAssembly port: node on_node.mjs PACKAGE FILE... ; the first file is the program,
// the others are the modules it imports. What it writes to stdout goes out as it is, each write at once.
import fs from "node:fs";
import path from "node:path";
import { pathToFileURL } from "node:url";

const [home, program, ...modules] = process.argv.slice(2);
const { loadMicroPython } = await import(pathToFileURL(path.join(home, "micropython.mjs")));
const python = await loadMicroPython({ linebuffer: false, stdout: (bytes) => fs.writeSync(1, bytes) });
for (const file of [...modules, "adc.txt"]) python.FS.writeFile(`/${path.basename(file)}`, fs.readFileSync(file));
python.runPython(fs.readFileSync(program, "utf8"));
