// The reference of the API.
import "./main.js";
import "./reference.js";
