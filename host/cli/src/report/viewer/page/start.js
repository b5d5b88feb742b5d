import { openFirst } from "viewer/app.js";

await openFirst();
